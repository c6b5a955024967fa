"""`haptic texture`: list, look at, check and play textures."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import numpy as np
import typer
from rich.table import Table
from rich.text import Text
from typer import Argument, Option

from haptic_driver.cli import control
from haptic_driver.cli.output import Json, ModelOption, RigOption, compiling, named, report, stdout
from haptic_driver.config import texture_dirs
from haptic_driver.daemon.verbs import Verbs
from haptic_driver.errors import BadInputError, require_range
from haptic_driver.pictures import textures as pictures
from haptic_driver.render.texture import Texture
from haptic_driver.signals import COURSE_POINTS, NO_COMMAND, TICK_S, FingerState, TargetFriction
from haptic_driver.textures.bands import (
    MEASURED_TO_M_S,
    Band,
    Output,
    asked,
    finger_gain,
    predicted,
)
from haptic_driver.textures.library import load, nameless_files, texture_names
from haptic_driver.textures.reach import SCREEN_M, WEBER, Demand, demand

if TYPE_CHECKING:
    from haptic_driver.render.controller import Controller
    from haptic_driver.rig.config import RigConfig
    from haptic_driver.rig.placement import Placement
    from haptic_driver.textures.ripple import Ripple

app = typer.Typer(no_args_is_help=True)
app.command("play")(control.command_of(Verbs.play))
SPEED_M_S = (0.002, 1.0)
Name = Annotated[str, named("textures", "Texture", Argument)]


@app.command("list")
def list_textures(as_json: Json = False) -> None:
    """List the textures that have names; a faulty file is listed with its fault.

    Example: `haptic texture list`
    """
    entries = [_entry(name) for name in texture_names(texture_dirs())]
    left_out = nameless_files(texture_dirs())

    def show() -> None:
        table = Table("name", "kind", "friction", "description")
        for entry in entries:
            low, high = entry["cof"] or (None, None)
            friction = (
                "" if low is None else f"{low:.3g}" if low == high else f"{low:.3g} to {high:.3g}"
            )
            table.add_row(
                entry["name"], entry["kind"] or "", friction, entry["error"] or entry["description"]
            )
        stdout.print(table)
        for file in left_out:
            stdout.print(f"left out: {file}, whose name does not print; give it another")

    report(as_json, {"textures": entries, "left_out": left_out}, show)


@app.command()
def preview(
    name: Name,
    out: Annotated[Path, Option(help="Picture to write (.png, .pdf or .svg).")] = Path(
        "texture.png"
    ),
    as_json: Json = False,
) -> None:
    """Draw a texture in the plane and along a line, or a script over time.

    Example: `haptic texture preview linen --out linen.png`
    """
    loaded = load(name, texture_dirs())
    pictures.preview(
        loaded.target, out, f"{name}: {loaded.description}" if loaded.description else name
    )
    report(as_json, {"picture": str(out)}, lambda: stdout.print(f"picture: {out}"))


@app.command()
def check(
    name: Name,
    normal_force: Annotated[float, Option(help="Normal force of the finger, N.")] = 0.5,
    model: ModelOption = "reference",
    surface: Annotated[Path | None, Option(help="Surface file instead of a model.")] = None,
    rig: RigOption = "simulated",
    speed: Annotated[float, Option(help="Speed of the finger, m/s.")] = 0.05,
    as_json: Json = False,
) -> None:
    """Say what a texture asks for and what of it is out of reach: under a load, and at a speed;
    flags are no failure.

    Nine bands of frequency show what the rig's output and a usual finger let through at that speed.
    They also show where the ripple of the carrier lies at the highest friction.

    Example: `haptic texture check linen --normal-force 0.5 --speed 0.05`
    """
    # slow to import
    from haptic_driver.daemon.set_up import off_m, placement_of  # noqa: PLC0415
    from haptic_driver.rig.config import load_rig  # noqa: PLC0415

    require_range("speed", speed, *SPEED_M_S, unit=" m/s")
    loaded = load(name, texture_dirs())
    config = load_rig(rig)
    controller = controller_of(config, model, surface, normal_force)
    reachable = controller.reachable(normal_force)
    found = demand(loaded.target, reachable)
    carrier = _carrier(controller, found.cof_high, normal_force, speed)
    bands = []
    if isinstance(loaded.target, Texture):
        met = loaded.target.under(speed, normal_force)
        bands = predicted(*asked(met, speed, SCREEN_M), reachable, output_of(config), speed)
    placed, detail_m = placement_of(config, speed), loaded.target.detail_m
    by_time = loaded.target.is_finer_than(off_m(config))
    payload = {
        "name": name,
        "kind": loaded.kind,
        "normal_force_n": normal_force,
        "reachable_cof": list(reachable),
        **found._asdict(),
        "perceptual_gain": loaded.perceptual_gain,
        "speed_m_s": speed,
        "bands": [band._asdict() for band in bands],
        "ripple": carrier.payload(),
        "detail_m": detail_m if math.isfinite(detail_m) else None,
        "placement": {
            "median_m": placed.median_m,
            "most_m": placed.most_m,
            "share_beyond_detail": placed.share_beyond(detail_m),
            "by": "time" if by_time else "space",
        },
    }

    def show() -> None:
        _show(name, loaded.kind, found, reachable, normal_force)
        if loaded.perceptual_gain != 1.0:
            gain = f"  friction varies {loaded.perceptual_gain:g} times as much as its file says"
            stdout.print(f"{gain} (perceptual_gain)")
        stdout.print(_by_time(placed) if by_time else _placed(placed, detail_m))
        if bands:
            _show_bands(bands, speed, carrier)

    report(as_json, payload, show)


def _entry(name: str) -> dict[str, Any]:
    try:
        loaded = load(name, texture_dirs())
    except BadInputError as error:
        return {
            "name": name,
            "kind": None,
            "cof": None,
            "description": "",
            "file": None,
            "error": error.message,
        }
    return {
        "name": name,
        "kind": loaded.kind,
        "cof": list(loaded.target.bounds()),
        "description": loaded.description,
        "file": str(loaded.path),
        "error": None,
    }


def output_of(config: RigConfig) -> Output:
    """How the rig brings out friction: points of an envelope, or set points."""
    from haptic_driver.rig.part import NoPart  # noqa: PLC0415

    if isinstance(config.analog_output, NoPart):
        return Output(config.output.setpoint_interval_s, straight=False)
    return Output(TICK_S / COURSE_POINTS, straight=True)


def reachable_by(
    config: RigConfig, model: str, surface: Path | None, normal_force_n: float
) -> tuple[float, float]:
    """The lowest and the highest friction under a load, within a rig's limits.

    By a model, or by a surface's file where one is given.
    """
    low, high = controller_of(config, model, surface, normal_force_n).reachable(normal_force_n)
    return float(low), float(high)


def controller_of(
    config: RigConfig, model: str, surface: Path | None, normal_force_n: float
) -> Controller:
    """The controller of a rig on such a surface, whose loads include this one."""
    # Slow to import, and no other command of this group needs them.
    from haptic_driver.lookup.build import build_surface  # noqa: PLC0415
    from haptic_driver.lookup.file import read_surface, ready_for_lookup  # noqa: PLC0415
    from haptic_driver.lookup.models import load_model  # noqa: PLC0415
    from haptic_driver.render.controller import Controller, ControllerSettings  # noqa: PLC0415

    limits = config.operating_limits()
    with compiling():
        file = read_surface(surface) if surface else build_surface(load_model(model), limits)
        lookup = ready_for_lookup(file, limits)
        own = config.controller.model_dump()
        controller = Controller(ControllerSettings(lookup, limits, **own))
    require_range("normal force", normal_force_n, *file.normal_force_n[[0, -1]].tolist(), unit=" N")
    return controller


class _Carrier(NamedTuple):
    """A carrier and the ripple that it leaves.

    `cof_rms`: of the friction that attraction would make at once; `finger_gain`: what a usual
    finger's friction follows of it.
    """

    carrier_hz: float
    ripple: Ripple
    cof_rms: float
    finger_gain: float

    def payload(self) -> dict[str, Any]:
        numbers = self._asdict()
        del numbers["ripple"]
        return self.ripple._asdict() | numbers


def _carrier(
    controller: Controller, cof: float, normal_force_n: float, speed_m_s: float
) -> _Carrier:
    """The carrier at the reachable friction nearest to `cof`."""
    from haptic_driver.render.controller import INITIAL  # noqa: PLC0415
    from haptic_driver.textures.ripple import ripple  # noqa: PLC0415

    target = TargetFriction(cof, True)
    finger = FingerState(0.0, 0.0, 0.0, speed_m_s, 0.0, normal_force_n, True)
    with compiling():
        _, point = controller.step(INITIAL, target, finger, NO_COMMAND)
    left = ripple(point.frequency_hz, controller.settings.quiet_above_hz)
    cof_rms = (point.cof - point.cof_low) / math.sqrt(2.0)
    gain = float(finger_gain(np.array(left.frequency_hz), speed_m_s))
    return _Carrier(point.frequency_hz, left, cof_rms, gain)


def _show(
    name: str, kind: str, found: Demand, reachable: tuple[float, float], normal_force_n: float
) -> None:
    stdout.print(f"{name} ({kind}): friction {found.cof_low:.4g} to {found.cof_high:.4g}")
    stdout.print(f"  {found.steps_felt:.1f} just noticeable steps of {WEBER:.0%}")
    stdout.print(
        f"  reachable under {normal_force_n:g} N: {reachable[0]:.4g} to {reachable[1]:.4g}"
    )
    stdout.print(f"  out of reach: {found.share_below:.1%} below, {found.share_above:.1%} above")
    stdout.print(f"  nothing asked for on {found.share_nothing:.1%} of the screen")
    for flag in found.flags:
        stdout.print(Text(f"  {flag}", "bold yellow"))


def _placed(placed: Placement, detail_m: float) -> str:
    """What this rig does to the texture's finest detail: half a period of a grating."""
    said = (
        f"  place at {1e3 * placed.speed_m_s:.3g} mm/s: off by {1e3 * placed.median_m:.2g} mm"
        f" (median), {1e3 * placed.most_m:.2g} mm (95 %); turns not reckoned"
    )
    if not math.isfinite(detail_m):
        return said
    share = f"{placed.share_beyond(detail_m):.0%}"
    return f"{said}; its finest detail, {1e3 * detail_m:.3g} mm, is missed for {share} of the time"


def _by_time(placed: Placement) -> str:
    """What this rig does to waves that are finer than places are known."""
    return (
        "  rendered by time: places are known less well than half a wave, so waves have the right"
        f" length, and lie {1e3 * placed.behind_m:.2g} mm behind at"
        f" {1e3 * placed.speed_m_s:.3g} mm/s"
    )


def _show_bands(bands: Sequence[Band], speed_m_s: float, carrier: _Carrier) -> None:
    table = Table(
        "Hz",
        "asked, rms",
        "output",
        "finger",
        "",
        title=f"at {speed_m_s:g} m/s",
        title_justify="left",
    )
    for band in bands:
        verdict = band.verdict.replace("_", " ")
        gains = (f"{band.output_gain:.0%}", f"{band.finger_gain:.0%}")
        table.add_row(
            f"{band.low_hz:.3g} to {band.high_hz:.3g}", f"{band.asked_cof_rms:.4f}", *gains, verdict
        )
    table.add_section()
    felt = "felt" if carrier.ripple.felt else "not felt"
    gain = f"{carrier.finger_gain:.0%}"
    hz = f"{carrier.ripple.frequency_hz:.3g}, ripple"
    table.add_row(hz, f"{carrier.cof_rms:.4f}", "", gain, felt)
    stdout.print(table)
    stdout.print(f"  ripple at the highest friction: {carrier.ripple}")
    if speed_m_s > MEASURED_TO_M_S:
        measured = f"  finger: measured up to {MEASURED_TO_M_S:g} m/s"
        stdout.print(f"{measured}, beyond it a line that goes on")
