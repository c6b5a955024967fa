"""Finger stage: raw samples -> contact, velocity, and the position when the output acts.

Position and velocity are a Kalman filter's, for a finger that moves on at its velocity. One
covariance serves both axes, since nothing tells them apart. Its gains follow from the reports
(interval, resolution, doubt of their times) and from how fingers move. There is no time constant to
choose.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

from haptic_driver.errors import BadInputError
from haptic_driver.signals import FingerSample, FingerState

# Of how a finger changes its velocity, white noise by assumption: in proportion to its speed (5 /s:
# by a third of itself in 20 ms), and where it is slow by no less than 14 mm/s in 20 ms. Of ten
# paths on a touch panel these are as likely as any (likelihood of their reports, flat to a factor
# of two).
CHANGE_PER_S, LEAST_CHANGE_M2_S3 = 5.0, 0.01
SHORTEST_S = 1e-4  # between reports of any tracker: what is closer tells no velocity


@dataclass(frozen=True)
class FingerSettings:
    """Contact begins at `contact_on_n` and ends below `contact_off_n` of normal force.

    `position_noise_m` and `report_jitter_s` are standard deviations of a report's place and of its
    time. `output_latency_s` is the time from a tick until the output that it decides acts on the
    finger. A reading is extrapolated to its tick by `longest_age_s` at most. Beyond that the
    tracker may be silent because the finger stands still.
    """

    contact_on_n: float = 0.08
    contact_off_n: float = 0.05
    output_latency_s: float = 0.0
    longest_age_s: float = 0.02
    position_noise_m: float = 3e-6
    report_jitter_s: float = 0.0

    def ahead_s(self, time_s: float, now_s: float) -> float:
        """From a report's time to when the output of the tick due at `now_s` acts."""
        return min(max(now_s - time_s, 0.0), self.longest_age_s) + self.output_latency_s

    def __post_init__(self) -> None:
        """Refuse settings that have no meaning."""
        if not 0.0 < self.contact_off_n <= self.contact_on_n < math.inf:
            raise BadInputError(
                "bad_finger_settings",
                f"contact_off_n {self.contact_off_n} and contact_on_n {self.contact_on_n} are no"
                " hysteresis",
                "choose 0 < contact_off_n <= contact_on_n",
            )
        if not 0.0 < self.position_noise_m < math.inf:
            raise BadInputError(
                "bad_finger_settings",
                f"position_noise_m {self.position_noise_m} is not a positive distance",
                "choose the tracker's resolution divided by the root of 12",
            )
        for name, wanted in (
            ("report_jitter_s", "the standard deviation of a report's time"),
            ("output_latency_s", "the measured time from a tick until the output acts"),
            ("longest_age_s", "some report intervals of the tracker"),
        ):
            if not 0.0 <= (value := getattr(self, name)) < math.inf:
                raise BadInputError(
                    "bad_finger_settings",
                    f"{name} {value} is not a time of zero or more",
                    f"choose {wanted}",
                )


class FingerTracking(NamedTuple):
    """What the stage remembers: the finger at the last report, by all reports of this touch.

    The variances are those of one axis and of both alike: of position, of position with velocity,
    of velocity. That of velocity is infinite until a second report. `touched_s` is when the touch
    began.
    """

    time_s: float
    position_x_m: float = math.nan
    position_y_m: float = math.nan
    velocity_x_m_s: float = 0.0
    velocity_y_m_s: float = 0.0
    variance_m2: float = math.nan
    covariance_m2_s: float = 0.0
    variance_m2_s2: float = math.inf
    in_contact: bool = False
    touched_s: float = math.nan

    @property
    def square_m2_s2(self) -> float:
        """Mean square of the velocity along one axis, with its doubt."""
        vx_m_s, vy_m_s = self.velocity_x_m_s, self.velocity_y_m_s
        return 0.5 * (vx_m_s * vx_m_s + vy_m_s * vy_m_s) + self.variance_m2_s2

    def std_m(self, ahead_s: float) -> float:
        """Standard deviation, along each axis, of where it will be so long after the report; inf
        while nobody knows its velocity.
        """
        if ahead_s == 0.0:
            return math.sqrt(self.variance_m2)
        by_velocity_m2 = ahead_s * (2.0 * self.covariance_m2_s + ahead_s * self.variance_m2_s2)
        by_change_m2 = _change_m2_s3(self.square_m2_s2) * ahead_s * ahead_s * ahead_s / 3.0
        return math.sqrt(self.variance_m2 + by_velocity_m2 + by_change_m2)


INITIAL = FingerTracking(math.nan)


def track(
    settings: FingerSettings, state: FingerTracking, sample: FingerSample
) -> tuple[FingerTracking, FingerState]:
    """Decide contact, estimate velocity and the position when the output acts.

    A steady speed is estimated without bias from the second sample of a touch on. Without contact
    the velocity is zero. A sample that is not finite or goes back in time is no contact, with
    position NaN and force zero. The next good one starts a new touch. A repeated time leaves the
    estimate as it was: the stage cannot see that a tracker stands still.
    """
    time_s, x_m, y_m, force_n, lateral_n, now_s, area_m2 = sample
    if not math.isfinite(now_s):
        now_s = time_s
    if not math.isfinite(time_s + x_m + y_m + force_n):  # each of them, then
        return _lost(state.time_s, now_s)
    if time_s < state.time_s:
        return _lost(time_s, now_s)
    if force_n < (settings.contact_off_n if state.in_contact else settings.contact_on_n):
        return _untouched(time_s), FingerState(now_s, x_m, y_m, 0.0, 0.0, force_n, in_contact=False)
    if not state.in_contact:
        state = _first(settings, sample, touched_s=time_s)
    elif time_s > state.time_s:
        state = _followed(settings, state, sample)

    ahead_s = settings.ahead_s(time_s, now_s)
    x_m = state.position_x_m + state.velocity_x_m_s * ahead_s
    y_m = state.position_y_m + state.velocity_y_m_s * ahead_s
    if not math.isfinite(x_m + y_m):
        return _lost(time_s, now_s)
    vx_m_s, vy_m_s = state.velocity_x_m_s, state.velocity_y_m_s
    contact_s = max(now_s - state.touched_s, 0.0)
    return state, FingerState(
        now_s,
        x_m,
        y_m,
        vx_m_s,
        vy_m_s,
        force_n,
        True,
        lateral_n,
        contact_s,
        contact_area_m2=area_m2,
    )


def _first(settings: FingerSettings, sample: FingerSample, touched_s: float) -> FingerTracking:
    """Where a touch is by one report: nothing tells its velocity yet."""
    noise_m2 = settings.position_noise_m * settings.position_noise_m
    return FingerTracking(
        sample.time_s,
        sample.position_x_m,
        sample.position_y_m,
        variance_m2=noise_m2,
        in_contact=True,
        touched_s=touched_s,
    )


def _followed(
    settings: FingerSettings, before: FingerTracking, sample: FingerSample
) -> FingerTracking:
    """The touch by one report more: predicted to its time, then drawn towards it.

    The doubt of a report is that of its place, and that of its time by the finger's speed.
    """
    _, x_m, y_m, vx_m_s, vy_m_s, variance_m2, covariance_m2_s, variance_m2_s2, _, _ = before
    dt_s = sample.time_s - before.time_s
    noise_m2 = settings.position_noise_m * settings.position_noise_m
    jitter_s2 = settings.report_jitter_s * settings.report_jitter_s
    if variance_m2_s2 == math.inf:  # the second report: all that is known of its velocity
        if dt_s < SHORTEST_S:
            return _first(settings, sample, before.touched_s)
        vx_m_s, vy_m_s = (sample.position_x_m - x_m) / dt_s, (sample.position_y_m - y_m) / dt_s
        x_m, y_m = sample.position_x_m, sample.position_y_m
        square_m2_s2 = 0.5 * (vx_m_s * vx_m_s + vy_m_s * vy_m_s)
        noise_m2 += jitter_s2 * square_m2_s2
        variance_m2, covariance_m2_s = noise_m2, noise_m2 / dt_s
        variance_m2_s2 = 2.0 * noise_m2 / (dt_s * dt_s) + _change_m2_s3(square_m2_s2) * dt_s / 3.0
    else:
        change_m2_s3 = _change_m2_s3(before.square_m2_s2)
        variance_m2 += dt_s * (2.0 * covariance_m2_s + dt_s * variance_m2_s2)
        variance_m2 += change_m2_s3 * dt_s * dt_s * dt_s / 3.0
        covariance_m2_s += dt_s * (variance_m2_s2 + 0.5 * change_m2_s3 * dt_s)
        variance_m2_s2 += change_m2_s3 * dt_s
        square_m2_s2 = 0.5 * (vx_m_s * vx_m_s + vy_m_s * vy_m_s) + variance_m2_s2
        noise_m2 += jitter_s2 * square_m2_s2
        gain = variance_m2 / (variance_m2 + noise_m2)
        gain_per_s = covariance_m2_s / (variance_m2 + noise_m2)
        x_m, y_m = x_m + vx_m_s * dt_s, y_m + vy_m_s * dt_s
        off_x_m, off_y_m = sample.position_x_m - x_m, sample.position_y_m - y_m
        x_m, y_m = x_m + gain * off_x_m, y_m + gain * off_y_m
        vx_m_s, vy_m_s = vx_m_s + gain_per_s * off_x_m, vy_m_s + gain_per_s * off_y_m
        variance_m2_s2 -= gain_per_s * covariance_m2_s
        variance_m2, covariance_m2_s = (1.0 - gain) * variance_m2, (1.0 - gain) * covariance_m2_s
    return FingerTracking(
        sample.time_s,
        x_m,
        y_m,
        vx_m_s,
        vy_m_s,
        variance_m2,
        covariance_m2_s,
        variance_m2_s2,
        True,
        before.touched_s,
    )


def _change_m2_s3(square_m2_s2: float) -> float:
    """Spectral density of what changes a velocity, by its mean square along one axis."""
    return LEAST_CHANGE_M2_S3 + CHANGE_PER_S * square_m2_s2


def _untouched(time_s: float) -> FingerTracking:
    return INITIAL._replace(time_s=time_s)


def _lost(time_s: float, now_s: float) -> tuple[FingerTracking, FingerState]:
    nowhere = FingerState(now_s, math.nan, math.nan, 0.0, 0.0, 0.0, in_contact=False)
    return _untouched(time_s), nowhere
