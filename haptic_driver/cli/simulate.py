"""`haptic simulate`: the simulated instruments of a rig, served until interrupted."""

from __future__ import annotations

import threading
import time
from functools import partial
from typing import Annotated

from rich.text import Text
from typer import Option

from haptic_driver.cli.output import (
    SIMULATED,
    Json,
    ModelOption,
    RigOption,
    report,
    signals_to,
    stdout,
)
from haptic_driver.errors import HapticError
from haptic_driver.lookup.models import load_model
from haptic_driver.processes.parent import outlived
from haptic_driver.rig.config import RigConfig, load_simulated_rig
from haptic_driver.simulation.served import ServedRig
from model.touch_model import TouchModel

STEP_S = 0.002


def simulate(
    rig: RigOption = "simulated",
    model: ModelOption = "reference",
    port: Annotated[
        int, Option(min=0, max=65535, help="TCP port of the waveform generator; 0: any free one.")
    ] = 0,
    as_json: Json = False,
) -> None:
    """Serve the simulated instruments of a rig on loopback until interrupted, for any software to
    talk to.

    The waveform generator and the interlock box are served over TCP and on pseudo-terminals. The
    stage is on a pseudo-terminal, the Net F/T box on UDP. Their addresses are printed once all
    answer. Time is real. Ctrl-C ends it, and so does the end of the shell or program that started
    it, except under `nohup`.

    Example: `haptic simulate --rig simulated --port 5025`
    """
    alone = outlived()
    config = load_simulated_rig(rig, "Name one that is, e.g. simulated")
    touch = TouchModel(load_model(config.simulation.model or model))
    ended = threading.Event()
    ending = signals_to(lambda number, frame: ended.set())
    with ending, _served(config, touch, port) as served:
        report(as_json, {"endpoints": served.endpoints}, partial(_show, served.endpoints))
        before_s = time.monotonic()
        while not (ended.wait(STEP_S) or alone()):
            now_s = time.monotonic()
            served.advance(now_s - before_s)
            before_s = now_s


def _served(config: RigConfig, touch: TouchModel, port: int) -> ServedRig:
    try:
        return ServedRig(config, touch, generator_port=port)
    except OSError as error:
        said = f"port {port} cannot be had ({error})"
        raise HapticError("port_taken", said, "Choose another --port, or 0") from error


def _show(endpoints: dict[str, str]) -> None:
    for name, where in endpoints.items():
        stdout.print(f"{name:26} {where}")
    stdout.print(Text.assemble(SIMULATED, "; Ctrl-C ends it"))
