"""A psychometric function from answers: maximum likelihood, with intervals from the profile of the
likelihood.

Few answers of a staircase fit best with a far too steep function, and its interval is then too
short. After 43 trials 80 % of the 95 % intervals held the truth. So a slope that is e times off the
usual one costs as much as a standard deviation. With that, 90 % of the intervals held the truth,
with the same thresholds.

A likelihood that rises for as far as one looks has no best threshold. No number is given where the
most probable one lies beyond all levels that were asked, and the interval is open on that side. The
answers say only on which side of the levels it lies.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq, minimize
from scipy.special import chdtri, xlog1py, xlogy
from scipy.stats import binomtest

from haptic_driver.errors import BadInputError
from haptic_driver.lab.psychophysics.description import HIGHEST_LAPSE
from haptic_driver.lab.psychophysics.functions import Form, Psychometric, probability
from haptic_driver.signals import Array

HIGHEST_GUESS = 0.5  # where it is found
SLOPES = (0.3, 15.0)  # of a Weibull; of a normal function in spans of the levels
# spans of the levels (in logarithms for a Weibull) beyond which no threshold is looked for
FURTHEST = 4.0
USUAL_SLOPE = {"weibull": 3.0, "normal": 4.0}
LEAST_TRIALS = 8
SURE = 1e-9  # no answer is quite impossible
ONE_SIDED = 0.10  # of a two-sided interval whose one end is a 95 % limit
BY_CHANCE = 0.01  # probability of answers that are no psychometric function's
FALLING = -2.33  # standard deviations of a trend, the same probability
AT_END = 1e-3  # of a parameter's range
SLOPE = 1  # its place among the parameters


@dataclass(frozen=True)
class Fit:
    """A function, its 95 % interval of the threshold (infinite where the data leave it open), and
    how it fits.

    `levels` [n] with `positive` of `count` answers each; `deviance` against a share of its own for
    every level. `why_none`: why the answers hold no threshold, else empty; where they say on which
    side of the levels it lies, the interval is one-sided. `notes`: what else not to rely on.
    """

    function: Psychometric
    interval_95: tuple[float, float]
    deviance: float
    levels: Array
    positive: Array
    count: Array
    why_none: str = ""
    notes: tuple[str, ...] = ()

    @property
    def threshold(self) -> float:
        """That of the function; NaN where the answers hold none."""
        return float("nan") if self.why_none else self.function.threshold

    @property
    def open_ends(self) -> tuple[bool, bool]:
        """Whether the interval has no lower end, and no upper one."""
        return _open_ends(self.function, self.interval_95)


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

    def least(
        self, starts: Sequence[Array], held: Mapping[int, float] | None = None
    ) -> tuple[float, Array]:
        """The least from any of these starts, with the arguments `held`, by their number, at a
        value.
        """
        fixed = {number: (value, value) for number, value in (held or {}).items()}
        bounds = [fixed.get(number, ends) for number, ends in enumerate(self.bounds)]
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
    function = likelihood.function(best)
    interval = _interval(likelihood, least, best)
    why_none = _why_none(likelihood, best, interval, x, y)
    if _falls(x, y):
        interval = (0.0 if form == "weibull" else -np.inf, np.inf)
    elif _side(function, interval, levels):
        interval = _one_sided(likelihood, least, best, interval)
    return Fit(
        function,
        interval,
        max(likelihood.deviance(best) - saturated, 0.0),
        levels,
        yes,
        count,
        why_none,
        tuple(_notes(likelihood, best, guess, y)) if not why_none else tuple(_chance(guess, y)),
    )


def _interval(
    likelihood: _Likelihood, least: float, best: Array, rest: float = 0.05
) -> tuple[float, float]:
    """Where the profile rises by the point of chi-square with one degree of freedom that leaves
    `rest`, on either side.
    """
    rise = float(chdtri(1, rest))

    def beyond(place: float) -> float:
        return likelihood.least([best], {0: place})[0] - least - rise

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


def _one_sided(
    likelihood: _Likelihood, least: float, best: Array, interval: tuple[float, float]
) -> tuple[float, float]:
    """The 95 % limit on the side that is not open."""
    low, high = _interval(likelihood, least, best, ONE_SIDED)
    return (interval[0], high) if np.isfinite(high) else (low, interval[1])


def _open_ends(function: Psychometric, interval: tuple[float, float]) -> tuple[bool, bool]:
    low, high = interval
    return bool(low == -np.inf or (function.form == "weibull" and low == 0.0)), bool(high == np.inf)


def _side(function: Psychometric, interval: tuple[float, float], levels: Array) -> str:
    """On which side of all levels the threshold lies, if that is all that the answers say."""
    lowest = levels[levels > 0.0].min() if function.form == "weibull" else levels[0]
    match _open_ends(function, interval):
        case True, False if function.threshold < lowest:
            return f"below {lowest:.4g}, the lowest level that was asked"
        case False, True if function.threshold > levels[-1]:
            return f"above {levels[-1]:.4g}, the highest level that was asked"
    return ""


def _why_none(
    likelihood: _Likelihood, best: Array, interval: tuple[float, float], x: Array, y: Array
) -> str:
    """Why answers `y` at levels `x` hold no threshold; empty where they do."""
    if _falls(x, y):
        return "positive answers become fewer as the level rises: are keys or intervals swapped?"
    function, levels = likelihood.function(best), np.unique(x)
    if _open_ends(function, interval) == (True, True):
        return "the answers leave the threshold open on both sides"
    if side := _side(function, interval, levels):
        return side
    if _at(likelihood, best, SLOPE) == -1:
        return "the answers hardly change with the level"
    return ""


def _falls(x: Array, y: Array) -> bool:
    """Whether positive answers become fewer with the level, by more than chance."""
    if x.std() == 0.0 or y.std() == 0.0:
        return False
    return float(np.corrcoef(x, y)[0, 1]) * float(np.sqrt(y.size)) < FALLING


def _notes(likelihood: _Likelihood, best: Array, guess: float | None, y: Array) -> list[str]:
    """What not to rely on of a function whose threshold the answers hold."""
    said = _chance(guess, y)
    function = likelihood.function(best)
    if _at(likelihood, best, SLOPE) == 1:
        said.append(f"the slope is {function.slope:.3g} or more, the steepest that is looked for")
    elif not _holds_slope(likelihood, best):
        said.append("the answers hardly tell the slope: it is the usual one")
    if _at(likelihood, best, 3) == 1:
        said.append(f"lapses are {100.0 * HIGHEST_LAPSE:g} % or more, the most that is looked for")
    if guess is None and _at(likelihood, best, 2) == 1:
        said.append(f"guesses are {100.0 * HIGHEST_GUESS:g} % or more, the most looked for")
    return said


def _chance(guess: float | None, y: Array) -> list[str]:
    """Whether answers are right less often than by guessing."""
    if not guess or binomtest(int(y.sum()), y.size, guess, "less").pvalue >= BY_CHANCE:
        return []
    return [
        f"{int(y.sum())} of {y.size} answers are positive, fewer than by chance"
        f" ({100.0 * guess:.3g} %): are keys or intervals swapped?"
    ]


def _at(likelihood: _Likelihood, best: Array, number: int) -> int:
    """-1 where an argument is at the low end of its range, 1 at the high end, else 0."""
    low, high = likelihood.bounds[number]
    near = AT_END * (high - low)
    return int(best[number] >= high - near) - int(best[number] <= low + near)


def _holds_slope(likelihood: _Likelihood, best: Array) -> bool:
    """Whether a slope e times off on one side makes the answers less probable by a standard
    deviation.
    """
    low, high = likelihood.bounds[SLOPE]
    off = [
        likelihood.least([best], {SLOPE: float(np.clip(best[SLOPE] + step, low, high))})[1]
        for step in (-1.0, 1.0)
    ]
    return any(likelihood.deviance(x) - likelihood.deviance(best) > 1.0 for x in off)
