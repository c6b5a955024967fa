"""Psychometric functions: how often a difference is answered, over its level.

    P(x) = guess + (1 - guess - lapse) F(x)

F is 0.5 at the threshold: without lapses 75 % of the answers are right there where two are to
choose from. Both forms are those of Wichmann & Hill (2001), Perception & Psychophysics 63, 1293,
written with that threshold.
"""

from __future__ import annotations

from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import ndtr

from haptic_driver.signals import Array

Form = Literal["weibull", "normal"]


class Psychometric(NamedTuple):
    """One function. `weibull` has levels above 0 and a slope without a unit; `normal` any level,
    and 1/level.
    """

    form: Form
    threshold: float
    slope: float
    guess: float = 0.5
    lapse: float = 0.0

    def at(self, level: ArrayLike) -> Array:
        """Share of positive answers at `level`, of its shape."""
        return probability(self.form, level, self.threshold, self.slope, self.guess, self.lapse)


def probability(
    form: Form, level: ArrayLike, threshold: Any, slope: Any, guess: Any, lapse: Any
) -> Array:
    """P of the head of this file; arguments are broadcast."""
    x = np.asarray(level, dtype=np.float64)
    if form == "normal":
        core = ndtr((x - threshold) * slope)
    else:
        core = 1.0 - np.exp2(-((np.maximum(x, 0.0) / threshold) ** slope))
    return np.asarray(guess + (1.0 - guess - lapse) * core)
