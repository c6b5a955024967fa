"""QUEST+ (Watson 2017, Journal of Vision 17(3):10): the level whose answer is expected to tell
most.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import xlogy

from haptic_driver.lab.psychophysics.description import QuestPlus, Range
from haptic_driver.lab.psychophysics.functions import Form, probability
from haptic_driver.signals import Array

GUESSES = (0.0, 0.02, 0.05, 0.1, 0.2)  # where yes and no are to choose from


class QuestPlusMethod:
    """The posterior over thresholds, slopes, guesses and lapses of a grid, all as likely at
    first.
    """

    def __init__(self, settings: QuestPlus, form: Form, guess: float | None) -> None:
        self._settings = settings
        self._levels = _spread(settings.levels, form)
        guesses = GUESSES if guess is None else (guess,)
        axes = np.meshgrid(
            _spread(settings.thresholds, form),
            settings.slopes,
            guesses,
            settings.lapses,
            indexing="ij",
        )
        self._thresholds, slopes, guessed, lapses = (axis.ravel() for axis in axes)
        self._rest = slopes, guessed, lapses
        self._form = form
        positive = self._likelihood(self._levels[:, None])
        self._answers = [(p, xlogy(p, p)) for p in (positive, 1.0 - positive)]
        self._posterior = np.full(self._thresholds.size, 1.0 / self._thresholds.size)
        self._trials = 0
        self._next: float | None = None

    @property
    def estimate(self) -> tuple[float, float]:
        """Mean and standard deviation of the threshold's posterior."""
        mean = float(self._posterior @ self._thresholds)
        return mean, float(np.sqrt(self._posterior @ (self._thresholds - mean) ** 2))

    def suggest(self) -> float | None:
        """The level of least expected entropy."""
        if self._next is None and not self._over():
            self._next = float(self._levels[np.argmin(self._expected_entropy())])
        return self._next

    def report(self, level: float, positive: bool) -> None:
        likelihood = self._likelihood(level)
        posterior = self._posterior * (likelihood if positive else 1.0 - likelihood)
        # else the answer is impossible by every function, and tells nothing
        if posterior.sum() > 0.0:
            self._posterior = posterior / posterior.sum()
        self._trials += 1
        self._next = None

    def _over(self) -> bool:
        mean, std = self.estimate
        return self._trials >= self._settings.trials or std < self._settings.stop_std * abs(mean)

    def _likelihood(self, level: ArrayLike) -> Array:
        """Of a positive answer, by every function of the grid."""
        return probability(self._form, level, self._thresholds, *self._rest)

    def _expected_entropy(self) -> Array:
        """Of the posterior after the next answer, per level [n]: sums of (p q) log(p q), taken
        apart.
        """
        q = self._posterior
        entropy = np.zeros(self._levels.size)
        for p, p_log_p in self._answers:
            answered = p @ q
            entropy += xlogy(answered, answered) - p_log_p @ q - p @ xlogy(q, q)
        return entropy


def _spread(over: Range, form: Form) -> Array:
    """Evenly, on a logarithmic axis where there is no level below 0."""
    ends = over.low, over.high, over.count
    return np.geomspace(*ends) if form == "weibull" else np.linspace(*ends)
