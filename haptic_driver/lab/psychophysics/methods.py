"""Which level comes next: methods that suggest one and take the answer.

All follow from their answers alone, so that an experiment goes on after a crash by replaying them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Protocol

import numpy as np

from haptic_driver.lab.psychophysics import description as said
from haptic_driver.lab.psychophysics.description import Experiment
from haptic_driver.lab.psychophysics.outside import OutsideMethod
from haptic_driver.lab.psychophysics.quest_plus import QuestPlusMethod


class Method(Protocol):
    """Suggests levels and hears of outcomes; others' optimisers plug in here (`outside.py`)."""

    def suggest(self) -> float | None:
        """The next level, the same until something is reported; None when there is nothing left to
        ask.
        """

    def report(self, level: float, positive: bool) -> None:
        """What came of a level, which may be another than was suggested. Positive: yes, or the
        comparison chosen.
        """


class ConstantMethod:
    """Every level as often as the others."""

    def __init__(self, levels: Sequence[float], repeats: int, rng: np.random.Generator) -> None:
        self._left = [float(x) for _ in range(repeats) for x in rng.permutation(levels)]

    def suggest(self) -> float | None:
        """The next of a shuffled list; each level comes once before any comes again."""
        return self._left[0] if self._left else None

    def report(self, level: float, positive: bool) -> None:
        """One less of it."""
        self._left.remove(min(self._left, key=lambda x: abs(x - level)))


class StaircaseMethod:
    """Levitt (1971), J. Acoust. Soc. Am. 49, 467: down after `down` positive answers in a row, up
    after `up` others.
    """

    def __init__(self, settings: said.Staircase) -> None:
        self._settings = settings
        self._level = settings.start
        self._in_a_row = 0  # positive answers above 0, negative ones below
        self._direction = 0
        self._trials = 0
        self.reversals: list[float] = []

    def suggest(self) -> float | None:
        settings = self._settings
        over = len(self.reversals) >= settings.reversals or self._trials >= settings.trials
        return None if over else self._level

    def report(self, level: float, positive: bool) -> None:
        """Step from where it stands, which only the nearest of a few textures may have stood
        for.
        """
        settings = self._settings
        self._trials += 1
        self._in_a_row = max(self._in_a_row, 0) + 1 if positive else min(self._in_a_row, 0) - 1
        direction = (
            -1 if self._in_a_row >= settings.down else 1 if self._in_a_row <= -settings.up else 0
        )
        if not direction:
            return
        self._in_a_row = 0
        if direction == -self._direction:
            self.reversals.append(self._level)
        self._direction = direction
        step = settings.steps[min(len(self.reversals), len(settings.steps) - 1)]
        linear = settings.scale == "linear"
        stepped = (
            self._level + direction * step if linear else self._level * (1.0 + step) ** direction
        )
        self._level = min(max(stepped, settings.low), settings.high)

    @property
    def estimate(self) -> float | None:
        """Mean of the last reversals, geometric where steps are ratios; None before there are
        two.
        """
        last = self.reversals[-self._settings.averaged :]
        if len(last) < 2:
            return None
        return (
            float(np.mean(last))
            if self._settings.scale == "linear"
            else float(np.exp(np.mean(np.log(last))))
        )

    @property
    def at_end(self) -> str:
        """What to say where half of the reversals that are averaged are those of the end of its
        range, which are nobody's threshold; else empty.
        """
        last = self.reversals[-self._settings.averaged :]
        for end in (self._settings.low, self._settings.high):
            there = sum(math.isclose(level, end) for level in last)
            if last and 2 * there >= len(last):
                return (
                    f"{there} of the {len(last)} last reversals lie at {end:.4g}, the end of the"
                    " staircase: their mean is no threshold"
                )
        return ""


def converges_at(settings: said.Staircase) -> float | None:
    """Share of positive answers where a staircase with `up` 1 comes to rest, p^down = 1/2; None for
    others.
    """
    return math.pow(0.5, 1.0 / settings.down) if settings.up == 1 else None


def method_of(experiment: Experiment, name: str, rng: np.random.Generator) -> Method:
    """The method of a condition, at its beginning. HapticError when an outside one cannot be
    had.
    """
    settings = experiment.file.method
    match settings:
        case said.Constant():
            return ConstantMethod(settings.levels, settings.repeats, rng)
        case said.Staircase():
            return StaircaseMethod(settings)
        case said.QuestPlus():
            analysis = experiment.file.analysis
            return QuestPlusMethod(settings, analysis.form, experiment.guess)
        case said.Outside():
            about = {"experiment": experiment.file.name, "condition": name}
            return OutsideMethod(settings, about, experiment.path.parent)
