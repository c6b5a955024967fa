"""Feedback from measured friction: what this finger's friction is compared with the surface's.

The surface says what friction a typical finger feels; this finger feels

    cof = off_gain * friction without voltage + rise_gain * rise through attraction.

Both gains are estimated while the finger slides, and the controller inverts the surface through them: the loop is
feed-forward through an estimated plant, so that voltage and carrier stay those of the surface and of its limits.

The law, per new reading of the force sensor: with h the two lateral forces that the surface alone gives for the
command in force `latency_s` ago, lagged as friction lags, and P the covariance of the gains x,

    x <- x + s P h (F - x.h) / (h.P h),    P <- P - s P h h^T P / (h.P h) + f (P0 - P),

s = 1 - exp(-dt/T), f = 1 - exp(-dt/memory_s), x kept within bounds; T is `time_constant_s` once the finger is known,
and down to `timing_s` before. It is the projection algorithm
(Goodwin and Sin, Adaptive Filtering Prediction and Control, 1984, ch. 3) in a metric that learns: the error of x never
grows, measured by P, and since P is drawn to P0 it neither winds up nor dies. The command takes part with its delay, so
delay does not destabilise: with a latency wrong by e the loop's gain is at most e/T, and it is stable
below 1 (small gain). `timing_s` within which commands differ slows learning down, to a stop where the output ramps.

Nothing is learnt while the finger is off, rests or has just set out, while force is unknown (NaN: stale, saturated) or
the same as before, while the carrier changes, or while the output comes on and nobody knows what of a command is out
(its voltage is NaN). A target out of reach cannot wind anything up, since friction is
compared with what the voltage really commanded should give, not with the target; learning goes on there, or a gain
believed too small would never be found out.
"""

from __future__ import annotations

from math import inf, isfinite, nan
from typing import NamedTuple

import numpy as np

from haptic_driver.errors import BadInputError
from haptic_driver.render.kernels import Array, Estimate, FeedbackSettings

COMMANDS_KEPT = 128
LONGEST_LATENCY_S = 0.1  # so far so many commands reach back, at 1 kHz


class FeedbackState(NamedTuple):
    """The fields of `Estimate` in a row, and the last commands [time, frequency, voltage], newest first."""

    known: Array
    commands: Array

    @property
    def estimate(self) -> Estimate:
        """What is known of the finger, by name."""
        return Estimate(*self.known.tolist())


def initial(settings: FeedbackSettings) -> FeedbackState:
    """Nothing measured yet. Raises BadInputError for settings that have no meaning."""
    wrong = [name for name, value in settings._asdict().items() if not (isfinite(value) and value >= 0.0)]
    if wrong:
        raise BadInputError(
            "bad_feedback", f"feedback {wrong[0]} is {getattr(settings, wrong[0])}", "give a finite number, 0 or more"
        )
    if settings.latency_s + settings.timing_s > LONGEST_LATENCY_S:
        raise BadInputError(
            "bad_feedback", f"feedback over a latency of {settings.latency_s:g} s is too late",
            f"give at most {LONGEST_LATENCY_S:g} s, timing included, or switch feedback off",
        )  # fmt: skip
    if not (
        settings.time_constant_s > settings.timing_s
        and settings.memory_s > settings.time_constant_s
        and 0.0 < settings.lowest_gain < 1.0 < settings.highest_gain
        and settings.correlation < 1.0
        and settings.deviation > 0.0
    ):
        raise BadInputError(
            "bad_feedback", f"feedback settings contradict one another: {settings}",
            "choose timing_s < time_constant_s < memory_s, 0 < lowest_gain < 1 < highest_gain, correlation < 1",
        )  # fmt: skip
    variance = settings.deviation**2
    estimate = NEUTRAL._replace(
        off_variance=variance, covariance=settings.correlation * variance, rise_variance=variance
    )
    return FeedbackState(np.array(estimate), np.full((3, COMMANDS_KEPT), nan))


NEUTRAL = Estimate(
    off_gain=1.0, rise_gain=1.0, off_variance=0.0, covariance=0.0, rise_variance=0.0,
    gain=1.0, gain_rate_per_s=0.0, learning=0.0, at_limit=0.0,
    expected_off_n=nan, expected_rise_n=nan, time_s=nan, reading_time_s=-inf, normal_force_n=nan, lateral_force_n=nan,
    slid_m=0.0,
)  # fmt: skip
NEUTRAL_KNOWN = np.array(NEUTRAL)
"""The finger that the surface was made for, by name and in a row."""
NO_FEEDBACK = FeedbackState(NEUTRAL_KNOWN, np.empty((3, 0)))
"""What is known where nothing is learnt."""
