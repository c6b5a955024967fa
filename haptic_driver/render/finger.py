"""Finger stage: raw samples -> contact, velocity, and the position when the output acts."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

from haptic_driver.errors import BadInputError
from haptic_driver.signals import FingerSample, FingerState

# Samples closer together than this share of the time constant count as one: their difference is
# noise, not speed.
SHORTEST_INTERVAL = 0.01


@dataclass(frozen=True)
class FingerSettings:
    """Contact begins at `contact_on_n` and ends below `contact_off_n` of normal force.

    `velocity_time_constant_s` smooths the velocity; `output_latency_s` is the time from a tick
    until the output that it decides acts on the finger. A reading is extrapolated to its tick by
    `longest_age_s` at most. Beyond that the tracker may be silent because the finger stands still.
    """

    contact_on_n: float = 0.08
    contact_off_n: float = 0.05
    velocity_time_constant_s: float = 0.010
    output_latency_s: float = 0.0
    longest_age_s: float = 0.02

    def __post_init__(self) -> None:
        """Refuse settings that have no meaning."""
        if not 0.0 < self.contact_off_n <= self.contact_on_n < math.inf:
            raise BadInputError(
                "bad_finger_settings",
                f"contact_off_n {self.contact_off_n} and contact_on_n {self.contact_on_n} are no"
                " hysteresis",
                "choose 0 < contact_off_n <= contact_on_n",
            )
        if not 0.0 < self.velocity_time_constant_s < math.inf:
            raise BadInputError(
                "bad_finger_settings",
                f"velocity_time_constant_s {self.velocity_time_constant_s} is not a positive time",
                "choose about 0.010",
            )
        if not 0.0 <= self.output_latency_s < math.inf:
            raise BadInputError(
                "bad_finger_settings",
                f"output_latency_s {self.output_latency_s} is not a time of zero or more",
                "choose the measured time from a tick until the output acts",
            )
        if not 0.0 <= self.longest_age_s < math.inf:
            raise BadInputError(
                "bad_finger_settings",
                f"longest_age_s {self.longest_age_s} is not a time of zero or more",
                "choose some report intervals of the tracker",
            )


class FingerTracking(NamedTuple):
    """What the stage remembers: the last time, the sample that velocity is measured from, the
    velocity so far.

    `weight` is how much of the smoothing window the touch has filled, 0 to 1. It keeps the velocity
    of a young touch from being drawn towards zero. `touched_s` is when the touch began.
    """

    time_s: float
    anchor_time_s: float
    anchor_x_m: float
    anchor_y_m: float
    velocity_x_m_s: float
    velocity_y_m_s: float
    weight: float
    in_contact: bool
    touched_s: float = math.nan


INITIAL = FingerTracking(math.nan, math.nan, math.nan, math.nan, 0.0, 0.0, 0.0, False)


def track(
    settings: FingerSettings, state: FingerTracking, sample: FingerSample
) -> tuple[FingerTracking, FingerState]:
    """Decide contact, estimate velocity and extrapolate the position to when the output acts.

    A steady speed is estimated without bias from the second sample of a touch on. Without contact
    the velocity is zero. A sample that is not finite or goes back in time is no contact, with
    position NaN and force zero. The next good one starts a new touch. A repeated time leaves the
    velocity as it was: the stage cannot see that a tracker stands still.
    """
    time_s, x_m, y_m, force_n, lateral_n, now_s = sample
    if not math.isfinite(now_s):
        now_s = time_s
    if not math.isfinite(time_s + x_m + y_m + force_n):  # each of them, then
        return _lost(state.time_s, now_s)
    if time_s < state.time_s:
        return _lost(time_s, now_s)
    if force_n < (settings.contact_off_n if state.in_contact else settings.contact_on_n):
        return _untouched(time_s), FingerState(now_s, x_m, y_m, 0.0, 0.0, force_n, in_contact=False)
    if not state.in_contact:
        touched = FingerTracking(
            time_s, time_s, x_m, y_m, 0.0, 0.0, 0.0, in_contact=True, touched_s=time_s
        )
        return touched, FingerState(now_s, x_m, y_m, 0.0, 0.0, force_n, in_contact=True)

    state = _follow(settings.velocity_time_constant_s, state, time_s, x_m, y_m)
    vx_m_s, vy_m_s = state.velocity_x_m_s, state.velocity_y_m_s
    age_s = min(max(now_s - time_s, 0.0), settings.longest_age_s)
    ahead_s = age_s + settings.output_latency_s
    x_m += vx_m_s * ahead_s
    y_m += vy_m_s * ahead_s
    if not math.isfinite(x_m + y_m):
        return _lost(time_s, now_s)
    contact_s = max(now_s - state.touched_s, 0.0)
    return state, FingerState(now_s, x_m, y_m, vx_m_s, vy_m_s, force_n, True, lateral_n, contact_s)


def _follow(
    time_constant_s: float, state: FingerTracking, time_s: float, x_m: float, y_m: float
) -> FingerTracking:
    """The velocity, smoothed exponentially over whatever intervals the samples come in."""
    _, anchor_time_s, anchor_x_m, anchor_y_m, vx_m_s, vy_m_s, weight, _, touched_s = state
    interval_s = time_s - anchor_time_s
    if interval_s < SHORTEST_INTERVAL * time_constant_s:
        return state._replace(time_s=time_s)
    share = -math.expm1(-interval_s / time_constant_s)
    weight += share * (1.0 - weight)
    gain = share / weight
    vx_m_s += gain * ((x_m - anchor_x_m) / interval_s - vx_m_s)
    vy_m_s += gain * ((y_m - anchor_y_m) / interval_s - vy_m_s)
    return FingerTracking(time_s, time_s, x_m, y_m, vx_m_s, vy_m_s, weight, True, touched_s)


def _untouched(time_s: float) -> FingerTracking:
    return INITIAL._replace(time_s=time_s)


def _lost(time_s: float, now_s: float) -> tuple[FingerTracking, FingerState]:
    nowhere = FingerState(now_s, math.nan, math.nan, 0.0, 0.0, 0.0, in_contact=False)
    return _untouched(time_s), nowhere
