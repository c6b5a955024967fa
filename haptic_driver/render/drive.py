"""Safe operating point -> drive command: the voltage rises at a bounded rate and falls at once."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf, isfinite, nan
from typing import NamedTuple

from haptic_driver.signals import DriveCommand, SafeOperatingPoint


@dataclass(frozen=True)
class DriveSettings:
    """`voltage_rise_v_per_s`: how fast the amplitude may grow, so that touch-down is not felt as a
    click.
    """

    voltage_rise_v_per_s: float = 10e3


class DriveState(NamedTuple):
    """The voltage last commanded and when; NaN before the first command."""

    time_s: float
    voltage_v: float


INITIAL = DriveState(nan, 0.0)


def drive(
    settings: DriveSettings, state: DriveState, point: SafeOperatingPoint, time_s: float
) -> tuple[DriveState, DriveCommand]:
    """The command for this instant; off for zero volts."""
    elapsed_s = time_s - state.time_s
    # the first command, a time that is none, or a clock that began again
    if not 0.0 < elapsed_s < inf:
        elapsed_s = 0.0
    voltage_v = min(point.voltage_v, state.voltage_v + settings.voltage_rise_v_per_s * elapsed_s)
    now_s = time_s if isfinite(time_s) else state.time_s
    return DriveState(now_s, voltage_v), DriveCommand(
        point.frequency_hz, voltage_v, voltage_v > 0.0
    )
