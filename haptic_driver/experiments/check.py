"""Which settings of a plan the rig permits, decided before anything is energised."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from haptic_driver.experiments.plan import Plan, Setting
from haptic_driver.experiments.stroke import beyond_stage
from haptic_driver.render.safety import violation
from haptic_driver.rig.config import RigConfig
from haptic_driver.signals import OperatingPoint
from model.conditions import Conditions
from model.touch_model import TouchModel


class Refusal(NamedTuple):
    """A setting that is not measured, and why."""

    setting: Setting
    reason: str

    def __str__(self) -> str:
        """For a person."""
        return told([self])[0]


def told(refusals: Sequence[Refusal]) -> list[str]:
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
) -> tuple[dict[Setting, OperatingPoint], list[Refusal]]:
    """The operating points of what `config` permits, with the currents that `model` predicts, and all refusals.

    `settings` are `plan`'s, or without voltage; its times decide how long a slide is.
    """
    table = np.array(settings, dtype=np.float64).reshape(-1, len(Setting._fields))
    answer = model.predict(Conditions(table[:, 0], table[:, 1], table[:, 2], speed_m_s=table[:, 3]))
    limits = config.operating_limits()
    points: dict[Setting, OperatingPoint] = {}
    refusals: list[Refusal] = []
    for i, setting in enumerate(settings):
        cof = float(answer.cof[i])
        currents = float(answer.current_rms_a[i]), float(answer.stuck_current_rms_a[i])
        point = OperatingPoint(setting.frequency_hz, setting.voltage_v, cof, *currents, True, cof, cof)
        reason = (
            _beyond_generator(setting, config)
            or beyond_stage(setting, plan, config)
            or (None if np.isfinite(cof) else "the model predicts that the contact pulls in")
            or violation(limits, point)
        )
        if reason is None:
            points[setting] = point
        else:
            refusals.append(Refusal(setting, reason))
    return points, refusals


def _beyond_generator(setting: Setting, config: RigConfig) -> str | None:
    kind = config.generator_kind()
    low_v, high_v = (
        0.5 * vpp * config.amplifier.gain_v_per_v for vpp in (kind.amplitude_low_vpp, kind.amplitude_high_vpp)
    )
    if setting.voltage_v == 0.0 or low_v <= setting.voltage_v <= high_v:
        return None
    return f"{setting.voltage_v:g} V is outside {low_v:g}..{high_v:g} V, what the generator can make"
