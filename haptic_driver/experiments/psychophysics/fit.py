"""A psychometric function from answers: maximum likelihood, with intervals from the profile of the
likelihood.

Few answers of a staircase fit best with a far too steep function, and its interval is then too
short: after 43 trials 80 % of the 95 % intervals held the truth. So a slope that is e times off the
usual one costs as much as a standard deviation; then 90 % did, with the same thresholds.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq, minimize
from scipy.special import chdtri, xlog1py, xlogy

from haptic_driver.errors import BadInputError
from haptic_driver.experiments.psychophysics.description import HIGHEST_LAPSE
from haptic_driver.experiments.psychophysics.functions import Form, Psychometric, probability
from haptic_driver.signals import Array

HIGHEST_GUESS = 0.5  # where it is found
SLOPES = (0.3, 15.0)  # of a Weibull; of a normal function in spans of the levels
FURTHEST = (
    4.0  # spans of the levels (in logarithms for a Weibull) beyond which no threshold is looked for
)
USUAL_SLOPE = {"weibull": 3.0, "normal": 4.0}
LEAST_TRIALS = 8
SURE = 1e-9  # no answer is quite impossible


@dataclass(frozen=True)
class Fit:
    """A function, its 95 % interval of the threshold (infinite where the data leave it open), and
    how it fits.

    `levels` [n] with `positive` of `count` answers each; `deviance` against a share of its own for
    every level.
    """

    function: Psychometric
    interval_95: tuple[float, float]
    deviance: float
    levels: Array
    positive: Array
    count: Array


class _Likelihood:
    """Of (threshold, slope, guess, lapse), the first two in units in which 0 is a good guess."""

    def __init__(
        self, form: Form, guess: float | None, levels: Array, positive: Array, count: Array
    ) -> None:
        self._form, self._positive, self._count = form, positive, count
        self._levels = levels
        seen = np.log(levels[levels > 0.0]) if form == "weibull" else levels
        low, high = float(seen.min()), float(seen.max())
        self.centre = float(
            np.average(levels, weights=count) if form == "normal" else 0.5 * (low + high)
        )
        self.span = max(high - low, 0.1 if form == "weibull" else 1e-3 * max(abs(high), 1e-3))
        self.bounds = [
            (-FURTHEST, FURTHEST),
            (np.log(SLOPES[0]), np.log(SLOPES[1])),
            (0.0, HIGHEST_GUESS) if guess is None else (guess, guess),
            (0.0, HIGHEST_LAPSE),
        ]

    def function(self, x: Array) -> Psychometric:
        place = self.centre + x[0] * self.span
        slope = float(np.exp(x[1]))
        if self._form == "weibull":
            return Psychometric("weibull", float(np.exp(place)), slope, float(x[2]), float(x[3]))
        return Psychometric("normal", float(place), slope / self.span, float(x[2]), float(x[3]))

    def place_of(self, threshold: float) -> float:
        """The first of its arguments."""
        return (
            (np.log(threshold) if self._form == "weibull" else threshold) - self.centre
        ) / self.span

    def threshold_of(self, place: float) -> float:
        return self.function(np.array([place, 0.0, 0.0, 0.0])).threshold

    def __call__(self, x: Array) -> float:
        """What is made least: twice the negative logarithm, and the price of an unusual slope."""
        return self.deviance(x) + float(x[1] - np.log(USUAL_SLOPE[self._form])) ** 2

    def deviance(self, x: Array) -> float:
        """Twice the negative logarithm."""
        f = self.function(x)
        p = np.clip(
            probability(f.form, self._levels, f.threshold, f.slope, f.guess, f.lapse),
            SURE,
            1.0 - SURE,
        )
        return -2.0 * float(
            np.sum(xlogy(self._positive, p) + xlog1py(self._count - self._positive, -p))
        )

    def least(self, starts: Sequence[Array], place: float | None = None) -> tuple[float, Array]:
        """The least from any of these starts, with the threshold held at `place` if that is
        given.
        """
        bounds = self.bounds if place is None else [(place, place), *self.bounds[1:]]
        low, high = (np.array(end) for end in zip(*bounds, strict=True))
        found = [
            minimize(self, np.clip(x, low, high), method="L-BFGS-B", bounds=bounds) for x in starts
        ]
        best = min(found, key=lambda result: float(result.fun))
        return float(best.fun), np.asarray(best.x)


def fit(level: Sequence[float], positive: Sequence[bool], form: Form, guess: float | None) -> Fit:
    """Fit the answers of one condition, one entry per trial; `guess` None is found too, as lapses
    are.

    BadInputError where there are too few trials, or all at levels that show nothing.
    """
    x, y = np.asarray(level, dtype=np.float64), np.asarray(positive, dtype=np.float64)
    if x.size < LEAST_TRIALS or (form == "weibull" and not np.any(x > 0.0)):
        said = f"{x.size} trials are too few for a psychometric function"
        raise BadInputError(
            "too_few_trials",
            said,
            f"At least {LEAST_TRIALS} that were delivered, at levels above 0",
        )
    levels, place = np.unique(x, return_inverse=True)
    yes, count = (np.bincount(place, weights=w).astype(np.float64) for w in (y, np.ones(y.size)))
    likelihood = _Likelihood(form, guess, levels, yes, count)
    guessed = 0.1 if guess is None else guess
    starts = [np.array([at, np.log(s), guessed, 0.01]) for at in (-0.3, 0.1) for s in (1.5, 4.0)]
    least, best = likelihood.least(starts)
    share = np.clip(yes / count, SURE, 1.0 - SURE)
    saturated = -2.0 * float(np.sum(xlogy(yes, share) + xlog1py(count - yes, -share)))
    interval = _interval(likelihood, least, best)
    return Fit(
        likelihood.function(best),
        interval,
        max(likelihood.deviance(best) - saturated, 0.0),
        levels,
        yes,
        count,
    )


def _interval(likelihood: _Likelihood, least: float, best: Array) -> tuple[float, float]:
    """Where the profile rises by the 95 % point of chi-square with one degree of freedom, on either
    side.
    """
    rise = float(chdtri(1, 0.05))

    def beyond(place: float) -> float:
        return likelihood.least([best], place)[0] - least - rise

    def end(sign: float) -> float:
        inside = outside = float(best[0])
        step = 0.05
        while sign * outside < FURTHEST:
            inside, outside, step = outside, outside + sign * step, 2.0 * step
            if beyond(outside) > 0.0:
                return likelihood.threshold_of(float(brentq(beyond, inside, outside, xtol=1e-3)))
        return sign * np.inf

    low, high = end(-1.0), end(1.0)
    return (max(low, 0.0) if likelihood.function(best).form == "weibull" else low), high
