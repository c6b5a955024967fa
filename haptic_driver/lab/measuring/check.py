"""Which settings of a plan the rig permits, decided before anything is energised."""

from __future__ import annotations

from collections.abc import Sequence
from math import floor, log10, pi
from typing import NamedTuple

import numpy as np

from haptic_driver.lab.measuring.plan import Plan, Setting
from haptic_driver.lab.measuring.stroke import beyond_stage
from haptic_driver.limits import OperatingLimits
from haptic_driver.render.safety import Worst, violation
from haptic_driver.rig.config import RigConfig
from haptic_driver.rig.evidence import MONITOR_QUIET_V
from haptic_driver.signals import Array, OperatingPoint
from hw.generator.settings import Shape
from model.conditions import Conditions
from model.touch_model import Prediction, TouchModel

MOST_OF_LIMIT = 0.99  # of what the limits allow, so that rounding does not exceed them
MOST_HARMONICS = 200  # of a square wave
COMING_N = 0.5  # the load of a finger that touches where none should be


class Judged(NamedTuple):
    """An operating point, and what finger and electrode get of it at worst, by the model."""

    point: OperatingPoint
    worst: Worst


class Refusal(NamedTuple):
    """A setting that is not measured, and why."""

    setting: Setting
    reason: str

    def __str__(self) -> str:
        return described([self])[0]


def described(refusals: Sequence[Refusal]) -> list[str]:
    """A line for each frequency, voltage and reason, over all its loads and speeds."""
    groups: dict[tuple[float, float, str], list[Setting]] = {}
    for setting, reason in refusals:
        groups.setdefault((setting.frequency_hz, setting.voltage_v, reason), []).append(setting)
    return [
        f"{frequency_hz:g} Hz, {voltage_v:g} V, {_span([s.normal_force_n for s in settings])} N, "
        f"{_span([1e3 * s.speed_m_s for s in settings])} mm/s: {reason}"
        for (frequency_hz, voltage_v, reason), settings in groups.items()
    ]


def _span(values: Sequence[float]) -> str:
    low, high = min(values), max(values)
    return f"{low:g}" if low == high else f"{low:g}..{high:g}"


def check(
    settings: Sequence[Setting], plan: Plan, config: RigConfig, model: TouchModel
) -> tuple[dict[Setting, Judged], list[Refusal]]:
    """The operating points of what `config` permits, with the currents that `model` predicts, and
    all refusals.

    `settings` are `plan`'s, or without voltage; its times decide how long a slide is.
    """
    answer = model.predict(_conditions(settings))
    electrode_v = _electrode_v(answer, settings)
    limits = config.sweep_limits()
    stuck_a = _stuck_a(settings, limits, model)
    points: dict[Setting, Judged] = {}
    refusals: list[Refusal] = []
    for i, setting in enumerate(settings):
        cof = float(answer.cof[i])
        currents = float(answer.current_rms_a[i]), float(stuck_a[i])
        # of a direct voltage: the strictest
        frequency_hz = setting.frequency_hz or config.limits.frequency_hz[0]
        point = OperatingPoint(frequency_hz, setting.peak_v, cof, *currents, True, cof, cof)
        worst = Worst(currents[1], electrode_v[i])
        reason = (
            _beyond_direct(setting, config)
            or _beyond_generator(setting, config)
            or _beyond_monitors(setting, config)
            or _without_force(setting, plan, config)
            or beyond_stage(setting, plan, config)
            or (None if np.isfinite(cof) else "the model predicts that the contact pulls in")
            or violation(limits, point, worst)
            or _beyond_harmonics(setting, limits, model)
        )
        if reason is None:
            points[setting] = Judged(point, worst)
        else:
            refusals.append(Refusal(setting, reason))
    return points, refusals


def resolved(settings: Sequence[Setting], config: RigConfig, model: TouchModel) -> list[Setting]:
    """Sweeps at the voltage that the rig allows there, to three digits: what they ask for, or the
    highest below it.

    `by_meter` is set where an instrument drives the electrode itself.

    A stuck or wet finger is the worst case, also where the plan says that there is none. Beyond the
    reach of the monitors that watch over the output only what they would call quiet is allowed.
    """
    answer = model.predict(_conditions(settings))
    limits = config.sweep_limits()
    found: list[Setting] = []
    electrode_v = _electrode_v(answer, settings)
    for setting, stuck_a, most_v in zip(
        settings, _stuck_a(settings, limits, model), electrode_v, strict=True
    ):
        if setting.sweep:
            per_volt = (stuck_a / setting.voltage_v, most_v / setting.voltage_v)
            highest_v = MOST_OF_LIMIT * float(
                limits.highest_voltage_v(setting.frequency_hz, *per_volt)
            )
            if meter := config.swept_by_meter(setting.frequency_hz):
                setting = setting._replace(by_meter=True)  # noqa: PLW2901
                highest_v = min(highest_v, meter.highest_v)
            elif setting.frequency_hz > config.monitor_reach_hz:
                highest_v = min(highest_v, MONITOR_QUIET_V)
            if highest_v < setting.voltage_v:
                lower_v = 10.0 ** (floor(log10(max(highest_v, 1e-9))) - 2)
                setting = setting._replace(  # noqa: PLW2901
                    voltage_v=round(floor(highest_v / lower_v) * lower_v, 12)
                )
        found.append(setting)
    return found


def _stuck_a(settings: Sequence[Setting], limits: OperatingLimits, model: TouchModel) -> Array:
    """Into all stuck contact that the limits hold for [n], A rms."""
    of_one, per_m2, _ = model.worst_case(_conditions(settings).drive())
    return limits.stuck_current(of_one, per_m2)


def _electrode_v(answer: Prediction, settings: Sequence[Setting]) -> list[float]:
    """The electrode's peak voltages, by the model's gain from set to electrode."""
    set_v = np.abs(
        np.broadcast_to(
            _conditions(settings).drive().fundamental_v, answer.electrode_voltage_v.shape
        )
    )
    gain = np.divide(
        np.abs(answer.electrode_voltage_v), set_v, out=np.zeros(set_v.shape), where=set_v > 0.0
    )
    return [float(g * s.peak_v) for g, s in zip(gain, settings, strict=True)]


def _conditions(settings: Sequence[Setting]) -> Conditions:
    """What the model is asked about; without a finger about one that might come."""
    return Conditions(
        frequency_hz=np.array([s.frequency_hz for s in settings]),
        voltage_v=np.array([s.voltage_v for s in settings]),
        normal_force_n=np.array([s.normal_force_n or COMING_N for s in settings]),
        voltage_offset_v=np.array([s.voltage_offset_v for s in settings]),
        waveform=np.array([s.waveform for s in settings], dtype=np.str_),
        speed_m_s=np.array([s.speed_m_s for s in settings]),
        time_s=np.array([s.time_s or 0.0 for s in settings]),
    )


def _beyond_monitors(setting: Setting, config: RigConfig) -> str | None:
    f, reach_hz = setting.frequency_hz, config.monitor_reach_hz
    if setting.by_meter:
        return None
    if f > reach_hz and setting.voltage_v > MONITOR_QUIET_V:
        return (
            f"above {reach_hz:g} Hz, where the rig's monitors alias, at most {MONITOR_QUIET_V:g} V"
            " are allowed"
        )
    if setting.sweep and config.electrode_monitor(f, sweep=True) is None:
        return f"no monitor of this rig's file tells {f:g} Hz"
    return None


def _without_force(setting: Setting, plan: Plan, config: RigConfig) -> str | None:
    """Without a force sensor there is no friction: what is left is the electrode, under the load
    that the rig's file takes for granted.
    """
    given = config.without_force
    if given is None:
        return None
    if abs(setting.normal_force_n - given.load_n) > plan.load_tolerance * setting.normal_force_n:
        return f"no force sensor: only the load of the rig's file is known, {given.load_n:g} N"
    if not setting.driven:
        return "no force sensor: without voltage nothing is measured"
    if config.electrode_monitor(setting.frequency_hz, setting.sweep) is None:
        return f"no force sensor, and no monitor tells {setting.frequency_hz:g} Hz"
    return None


def _beyond_direct(setting: Setting, config: RigConfig) -> str | None:
    allowed_v = config.limits.direct_voltage_v
    direct_v = abs(setting.voltage_offset_v) + (
        setting.voltage_v if setting.waveform == "dc" else 0.0
    )
    if setting.voltage_offset_v and (setting.voltage_v == 0.0 or setting.waveform == "dc"):
        return "a direct voltage alone is waveform dc, with its voltage_v and no voltage_offset_v"
    if direct_v > allowed_v:
        return (
            f"a direct voltage of {direct_v:g} V exceeds limits.direct_voltage_v, {allowed_v:g} V"
        )
    return None


def _beyond_harmonics(setting: Setting, limits: OperatingLimits, model: TouchModel) -> str | None:
    """A square wave's harmonics: the shares that each takes of its own limit of current must not
    exceed 1 together.
    """
    if setting.waveform != "square":
        return None
    order = np.arange(1.0, MOST_HARMONICS, 2.0)
    frequency_hz, voltage_v = order * setting.frequency_hz, 4.0 / (pi * order) * setting.voltage_v
    sine = setting._replace(waveform="sine")
    harmonics = [
        sine._replace(frequency_hz=f, voltage_v=v)
        for f, v in zip(frequency_hz, voltage_v, strict=True)
    ]
    worst_a = _stuck_a(harmonics, limits, model)
    share = float(np.sum(worst_a / limits.contact_current_limit_a_rms(frequency_hz)))
    return (
        None
        if share <= 1.0
        else f"the square wave's harmonics take {share:.3g} times the worst-case finger current"
    )


def _beyond_generator(setting: Setting, config: RigConfig) -> str | None:
    if setting.by_meter:
        return None
    kind = config.generator_kind()
    needed = Shape.DC if setting.voltage_offset_v else Shape(setting.waveform)
    if needed not in kind.shapes:
        what = "bias" if setting.voltage_offset_v else f"waveform {setting.waveform}"
        return f"the generator, {config.waveform_generator.model}, makes no {what}"
    low_v, high_v = (
        0.5 * vpp * config.amplifier.gain_v_per_v
        for vpp in (kind.amplitude_low_vpp, kind.amplitude_high_vpp)
    )
    if not setting.driven or low_v <= setting.voltage_v <= setting.peak_v <= high_v:
        return None
    return f"{setting.peak_v:g} V is outside {low_v:g}..{high_v:g} V, what the generator can make"
