"""`haptic load`: a load stage holds a finger's load."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from typing import Annotated

import typer
from typer import Argument, Option

from haptic_driver.cli import control, load_by_daemon
from haptic_driver.cli.daemon import SocketOption
from haptic_driver.cli.output import Json, confirm_attended, named, report, status, stderr, stdout
from haptic_driver.daemon.verbs import Verbs
from haptic_driver.errors import HapticError, require_range
from haptic_driver.lookup.models import load_model
from haptic_driver.rig.config import RigConfig, load_rig
from haptic_driver.rig.devices import LoadDevices, connect_load
from haptic_driver.rig.load_loop import LoadLoop, make_clear
from haptic_driver.rig.parts.load_stages import LoadStageSection
from haptic_driver.simulation.rig import SimulatedRig
from model.touch_model import TouchModel

app = typer.Typer(no_args_is_help=True)
SETTLE_S = 30.0
LONGEST_S = 24 * 3600.0
Yes = Annotated[bool, Option("--yes", help="Begin without asking; somebody is there.")]


@app.command()
def hold(
    newtons: Annotated[float, Argument(help="Load to hold, N.")],
    rig: Annotated[str | None, named("rigs", "Rig; the daemon's if left out")] = None,
    seconds: Annotated[float | None, Option(help="So long; until Ctrl-C if left out.")] = None,
    yes: Yes = False,
    socket: SocketOption = None,
    as_json: Json = False,
) -> None:
    """Hold a finger's load by the rig's load stage.

    Where a daemon runs on the rig it holds the load, so that friction can be rendered meanwhile.
    Without a daemon and `--rig` the rig is `simulated-paper`.
    The lease is that of `haptic arm`, or else the command's own. Ctrl-C, `haptic load release`,
    `haptic off` and the end of the lease let go.

    Without a daemon it opens the force sensor and the load stage alone: nothing is energised. A
    simulated rig then holds `--seconds` of its own time.

    The stage lifts off, or stops, as the rig's file says, at the end and when anything is wrong.

    Example: `haptic load hold 0.5 --rig simulated-paper --seconds 10`
    """
    if seconds is not None:
        require_range("--seconds", seconds, 0.1, LONGEST_S, unit=" s")
    config = load_rig(rig or "simulated-paper")
    client = load_by_daemon.daemon_on(rig and config.name, socket)
    if client is not None:
        if not (yes or client.status().simulated):
            stderr.print(f"the load stage will move, and press with {newtons:g} N")
            confirm_attended(client.status().rig)
        held = load_by_daemon.hold(client, newtons, seconds)
        report(as_json, held, lambda: _said(newtons, held["mean_load_n"]))
        return
    with pressed(config, newtons, yes, in_real_time=seconds is None) as loop:
        where = " on a simulated finger, without a daemon" if config.simulated else ""
        stderr.print(f"holding {newtons:g} N{where}; Ctrl-C lets go")
        mean_n, depth_m = loop.average(LONGEST_S if seconds is None else seconds)
    said = {"load_n": newtons, "mean_load_n": mean_n, "depth_m": depth_m}
    report(as_json, said, lambda: _said(newtons, mean_n))


def _said(newtons: float, mean_n: float) -> None:
    if math.isnan(mean_n):
        stdout.print(f"let go before {newtons:g} N was held")
    else:
        stdout.print(f"held {newtons:g} N, mean {mean_n:.3f} N")


app.command("release")(control.command_of(Verbs.release_load))


@contextmanager
def pressed(
    config: RigConfig, newtons: float, yes: bool, in_real_time: bool = False
) -> Iterator[LoadLoop]:
    """The loop of a rig's load stage at its load; it lets go at the end, whatever ends it."""
    clock: Callable[[], float] = time.monotonic
    sleep: Callable[[float], object] = time.sleep
    if config.load_stage.is_simulated:
        model = TouchModel(load_model(config.simulation.model or "reference"))
        simulated = SimulatedRig(config, model, friction=lambda *condition: 0.0)  # nothing slides
        devices: LoadDevices = simulated.devices
        clock = simulated.clock

        def pass_time(duration_s: float) -> None:
            if in_real_time:
                time.sleep(duration_s)
            simulated.sleep(duration_s)

        sleep = pass_time
    else:
        devices = connect_load(config)
    section, stage = config.load_stage, devices.load_stage
    assert isinstance(section, LoadStageSection)  # or there would be no devices
    assert stage is not None
    settings = section.loop(newtons)
    if not (yes or config.simulated):
        stderr.print(
            f"rig {config.name}: the load stage will move, and press with {newtons:g} N. Take the"
            " finger off: the force sensor's bias comes first."
        )
        confirm_attended(config.name)
    with _unless_held(devices), status("load stage") as tell:
        tell("to where the finger is free: keep clear")
        make_clear(stage, section.mounting())
        with LoadLoop(
            stage,
            devices.force_sensor,
            settings,
            section.mounting(),
            clock=clock,
            sleep=sleep,
            guard=devices.watchdog,
        ) as loop:
            tell(f"pressing with {newtons:g} N")
            loop.settle(SETTLE_S)
            tell(f"{newtons:g} N pressed")
            yield loop
        if doubt := loop.doubt():
            raise HapticError("load_in_doubt", doubt, "Free the sensor, and hold the load again")


@contextmanager
def _unless_held(devices: LoadDevices) -> Iterator[None]:
    """Open; where another program has the rig, say what holds a load then."""
    with ExitStack() as opened:
        try:
            opened.enter_context(devices)
        except HapticError as error:
            if error.code != "in_use":
                raise
            hint = "If it is a daemon, name its --socket; haptic measure holds loads by itself"
            raise HapticError("in_use", error.message, hint) from error
        yield
