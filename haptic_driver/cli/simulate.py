"""`haptic simulate`: the simulated instruments of a rig, served until interrupted."""

from __future__ import annotations

import threading
from functools import partial
from pathlib import Path
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
from haptic_driver.errors import BadInputError, HapticError
from haptic_driver.files import write_text
from haptic_driver.lookup.models import load_model
from haptic_driver.processes.parent import outlived
from haptic_driver.processes.real_time import settle_memory
from haptic_driver.rig.config import RigConfig, load_rig
from haptic_driver.rig.parts.finger_trackers import StageFingerConfig
from haptic_driver.rig.slide import synthetic_slide
from haptic_driver.simulation.served import STEP_S, ServedRig, finger_at_once
from haptic_driver.simulation.twin import as_real, file_of, twin_of
from model.touch_model import TouchModel

HEAD = "# Written by haptic simulate: a rig whose instruments it serves, as long as it runs.\n"


def simulate(
    rig: RigOption = "simulated",
    model: ModelOption = "reference",
    port: Annotated[
        int, Option(min=0, max=65535, help="TCP port of the waveform generator; 0: any free one.")
    ] = 0,
    like: Annotated[
        Path | None, Option(help="File of a real rig, of which to serve twins, in place of --rig.")
    ] = None,
    out: Annotated[
        Path | None,
        Option(
            help=(
                "With --like: the copy of that file that points at the twins; by default"
                " FILE-simulated.toml."
            )
        ),
    ] = None,
    as_json: Json = False,
) -> None:
    """Serve the simulated instruments of a rig on loopback until interrupted, for any software to
    talk to.

    The waveform generator and the interlock box are served over TCP and on pseudo-terminals. The
    stage is on a pseudo-terminal, the Net F/T box on UDP. Their addresses are printed once all
    answer. Time is real. Ctrl-C ends it, and so does the end of the shell or program that started
    it, except under `nohup`.

    With `--like` it serves simulated twins of your own rig, and writes a copy of its file that
    points at them. Doctor, measure and daemon run on the copy, by your rig's own drivers.

    Example: `haptic simulate --rig simulated --port 5025`
    """
    alone = outlived()
    ended = threading.Event()
    ending = signals_to(lambda number, frame: ended.set())
    left_out: list[str] = []
    if like is None:
        if out is not None:
            raise BadInputError("usage", "--out is where the copy goes", "Give --like FILE too")
        config = load_rig(rig)
        if not config.simulated:
            hint = "Serve twins of it: haptic simulate --like FILE"
            raise BadInputError("not_simulated", f"rig {config.name} is not simulated", hint)
        touch = TouchModel(load_model(config.simulation.model or model))
        made = partial(ServedRig, as_real(config), touch)
    else:
        out = _copy_of(like, out)
        config, left_out = twin_of(_real(like))
        rides = isinstance(config.finger_tracker, StageFingerConfig)
        slide = None if rides else synthetic_slide()
        made = partial(ServedRig, config, finger_at_once(config, model), slide)
    with ending, _on_port(made, port) as served:
        said: dict[str, object] = {"endpoints": served.endpoints}
        if out is not None:
            write_text(out, HEAD + file_of(served.config))
            said |= {"rig": str(out), "left_out": left_out}
        settle_memory()
        report(as_json, said, partial(_show, served.endpoints, out, left_out))
        while not (ended.wait(STEP_S) or alone()):
            served.catch_up()


def _real(like: Path) -> RigConfig:
    config = load_rig(str(like))
    if config.simulated:
        said = f"rig {config.name} is simulated already"
        raise BadInputError("simulated", said, f"haptic simulate --rig {like}")
    return config


def _copy_of(like: Path, out: Path | None) -> Path:
    """Where the copy goes: over an earlier copy, but over no file of a person."""
    out = out or Path(f"{like.stem}-simulated.toml")
    if out.exists() and not out.read_text(encoding="utf-8", errors="replace").startswith(HEAD):
        raise BadInputError(
            "file_exists",
            f"{out}: exists already",
            "Give another --out: it is no copy that this command wrote",
        )
    return out


def _on_port(made: partial[ServedRig], port: int) -> ServedRig:
    try:
        return made(generator_port=port)
    except OSError as error:
        said = f"port {port} cannot be had ({error})"
        raise HapticError("port_taken", said, "Choose another --port, or 0") from error


def _show(endpoints: dict[str, str], copy: Path | None, left_out: list[str]) -> None:
    for name, where in endpoints.items():
        stdout.print(f"{name:26} {where}")
    for said in left_out:
        stdout.print(Text(f"left out: {said}", "yellow"))
    if copy is not None:
        stdout.print(Text(f"{copy} points at these; next: haptic doctor --rig {copy}"))
    stdout.print(Text.assemble(SIMULATED, "; Ctrl-C ends it"))
