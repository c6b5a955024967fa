"""Envelope: the amplitude within one tick, for a carrier whose amplitude an analog output can
change fast.

A tick is too slow for texture: at 100 mm/s a ridge of 0.2 mm is 500 Hz. So the texture is evaluated
along the path of the finger until the next tick, and the controller gives the voltage of each
point. The force goes with the voltage squared, and is linear between points. The envelope is the
square root of that line.

Everything here is pure, as in `tick.py`. The render process calls `ahead` after `tick`; the
actuator makes samples of it with `synthesise`, at the rate and pace of its own output.
"""

from __future__ import annotations

from functools import cache
from math import nan

import numpy as np

from haptic_driver.render import drive, safety
from haptic_driver.render.compiled import kernel
from haptic_driver.render.tick import Tick, TickSettings, TickState
from haptic_driver.signals import COURSE_POINTS, Array, OperatingPoint

_SHARES = np.arange(1, COURSE_POINTS + 1) / COURSE_POINTS
ZERO = np.zeros(COURSE_POINTS)


def ahead(
    stages: TickSettings, after: TickState, done: Tick, tick_s: float
) -> tuple[TickState, Array]:
    """Peak voltage squared, V^2 [COURSE_POINTS], from this tick to the next, the last point at the
    next.

    For a tick whose command is what was wanted, neither rising nor ramped down: then the texture
    may move as fast as it likes. Zero without contact, where nothing is asked for, and all of it
    where the last gate refuses any of it.
    """
    finger = done.finger
    if not finger.in_contact or done.safe.rejection is not None:
        return after, ZERO
    cof = stages.texture.cof_along(done.placed, _moments_s(tick_s))
    known, carrier_hz = after.controller.estimate, done.wanted.frequency_hz
    voltage_v, peak = stages.controller.along(known, cof, finger, carrier_hz)
    worst = safety.Worst(*safety.worst_at(stages.worst_case, carrier_hz, peak.voltage_v))
    guard, refused = safety.gate_envelope(stages.limits, after.safety, peak, worst, voltage_v)
    if refused:
        return after._replace(safety=guard), ZERO
    # The next tick's rise begins where this way ends.
    driven = drive.DriveState(after.drive.time_s, voltage_v.item(-1))
    return (after._replace(safety=guard, drive=driven), voltage_v * voltage_v)


def full_scale_v(stages: TickSettings, carrier_hz: float) -> float:
    """Peak voltage of a carrier where its envelope is at its highest, and where Modulation In
    fails.

    It is the most that is allowed under any load, if the last gate agrees; nothing otherwise.
    """
    most_v = stages.controller.full_scale_v(carrier_hz)
    point = OperatingPoint(carrier_hz, most_v, nan, 0.0, 0.0, True, nan, nan)
    worst = safety.Worst(*safety.worst_at(stages.worst_case, carrier_hz, most_v))
    return most_v if safety.violation(stages.limits, point, worst) is None else 0.0


@cache
def _moments_s(tick_s: float) -> Array:
    return tick_s * _SHARES


def straight(begin_v2: float, end_v2: float) -> Array:
    """The same for a tick that rises by the drive stage, or falls: a fall is at once."""
    return (
        np.full(COURSE_POINTS, end_v2)
        if begin_v2 >= end_v2
        else begin_v2 + (end_v2 - begin_v2) * _SHARES
    )


@kernel
def synthesise(powers_v2: Array, out: Array) -> None:
    """Peak voltages `out` [m] between `powers_v2` [n + 1], the first of which was reached before
    the first sample.

    Both are evenly spaced and end together. Straight lines in voltage squared.
    """
    points = powers_v2.size - 1
    per_sample = points / out.size
    for m in range(out.size):
        place = (m + 1) * per_sample
        k = min(int(place), points - 1)
        power_v2 = powers_v2[k] + (place - k) * (powers_v2[k + 1] - powers_v2[k])
        out[m] = np.sqrt(max(power_v2, 0.0))
