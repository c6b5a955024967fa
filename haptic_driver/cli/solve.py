"""`haptic solve`: the operating point for a target friction."""

from __future__ import annotations

import math
from functools import partial
from pathlib import Path
from typing import Annotated, Any

from typer import Option

from haptic_driver.base.units import readable
from haptic_driver.cli.output import Json, ModelOption, RigOption, report, stdout
from haptic_driver.errors import BadInputError
from haptic_driver.lookup.build import build_surface
from haptic_driver.lookup.file import cof_interval_at, read_surface
from haptic_driver.lookup.models import load_model
from haptic_driver.lookup.operating_point import (
    controller_by,
    electrostatic_force_n,
    operating_point,
)
from haptic_driver.render.policies import POLICIES, description
from haptic_driver.rig.config import load_rig
from haptic_driver.textures.ripple import QuietReach, Ripple, quiet_reach, ripple
from model.analysis import uncertainty
from model.analysis.voltage_law import beyond_published
from model.description import ModelDescription
from model.support.cells import number
from model.touch_model import TouchModel

POLICIES_SAID = " ".join(f"{name}: {description(name)}" for name in POLICIES)


def solve(
    friction: Annotated[float, Option(help="Target coefficient of friction.")],
    normal_force: Annotated[float, Option(help="Normal force of the finger, N.")] = 0.5,
    frequency: Annotated[str, Option(help="'auto' or a frequency in Hz.")] = "auto",
    policy: Annotated[
        str | None, Option(help=POLICIES_SAID, autocompletion=lambda: list(POLICIES))
    ] = None,
    model: ModelOption = "reference",
    surface: Annotated[Path | None, Option(help="Surface file instead of a model.")] = None,
    rig: RigOption = "simulated",
    as_json: Json = False,
) -> None:
    """Find the frequency and voltage that give a target friction within the rig's limits.

    Example: `haptic solve --friction 0.60 --normal-force 0.5 --policy min_voltage`
    """
    config = load_rig(rig)
    limits = config.operating_limits()
    fixed_hz = _frequency(frequency)
    description = None
    if surface is not None:
        file = read_surface(surface)
        interval_at = partial(cof_interval_at, file)
    else:
        description = load_model(model)
        file = build_surface(description, limits)
        interval_at = partial(_interval_at, description)
    own = config.controller.model_dump()
    controller = controller_by(file, limits, own, policy, fixed_hz)
    point = operating_point(controller, file, friction, normal_force)
    interval = interval_at(point.frequency_hz, point.voltage_v, normal_force)
    steep = None
    if description is not None:
        at = point.frequency_hz, point.voltage_v, normal_force
        steep = beyond_published(TouchModel(description), *at)
    left = ripple(point.frequency_hz, config.controller.quiet_above_hz)
    without = quiet_reach(controller.settings, normal_force)
    payload: dict[str, Any] = {
        "frequency_hz": point.frequency_hz,
        "voltage_v": point.voltage_v,
        "cof": point.cof,
        "electrostatic_force_n": electrostatic_force_n(file, point.cof, normal_force),
        "current_rms_a": point.current_rms_a,
        "policy": controller.settings.policy,
        "reachable_cof": list(controller.reachable(normal_force)),
        "cof_interval": None if interval is None else list(interval),
        "ripple": left._asdict(),
        "quiet_reach": without._asdict(),
        "notes": [] if steep is None else [steep],
    }

    def show() -> None:
        _show(payload, normal_force)
        _show_ripple(left, without)
        for note in payload["notes"]:
            stdout.print(f"  note: {note}")

    report(as_json, payload, show)


def _interval_at(
    model: ModelDescription, frequency_hz: float, voltage_v: float, normal_force_n: float
) -> tuple[float, float] | None:
    """As `cof_interval_at` reads it from a surface; the equations as printed have none."""
    if model.is_published:
        return None
    return uncertainty.cof_interval_at(model, frequency_hz, voltage_v, normal_force_n)


def _show(found: dict[str, Any], normal_force_n: float) -> None:
    stdout.print(
        f"{found['frequency_hz']:.4g} Hz, {found['voltage_v']:.4g} V peak at the electrode"
        f" ({found['policy']})"
    )
    stdout.print(
        f"  friction {found['cof']:.4g} under {normal_force_n:g} N, electrostatic force "
        f"{readable(found['electrostatic_force_n'], 'N')}, finger current"
        f" {readable(found['current_rms_a'], 'A rms')}"
    )
    if found["cof_interval"] is not None:
        low, high = found["cof_interval"]
        stdout.print(
            f"  with the model's uncertainty this friction is {low:.4g} to {high:.4g} (68 %)"
        )
    low, high = found["reachable_cof"]
    stdout.print(f"  reachable here: {low:.4g} to {high:.4g}")


def _show_ripple(left: Ripple, without: QuietReach) -> None:
    stdout.print(f"  ripple of friction at {left}")
    low, high = without.cof
    most = without.any_cof[1]
    stdout.print(
        f"  without a felt ripple (policy quiet): {low:.4g} to {high:.4g}, "
        f"{without.share:.1%} of the authority that reaches {most:.4g}"
    )


def _frequency(text: str) -> float | None:
    if text == "auto":
        return None
    try:
        value = number(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value) or value <= 0.0:
        raise BadInputError(
            "bad_frequency", f"--frequency {text} is no frequency", "Give 'auto' or a number in Hz"
        )
    return value
