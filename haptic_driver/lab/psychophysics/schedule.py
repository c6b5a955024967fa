"""The order of trials: a pure function of the file, the participant, and what was answered so
far.
"""

from __future__ import annotations

import re
import zlib
from typing import NamedTuple

import numpy as np

from haptic_driver.errors import BadInputError
from haptic_driver.lab.psychophysics.description import Experiment, Stimulus
from haptic_driver.lab.psychophysics.methods import Method, method_of

BLOCKS, METHODS, TRIALS = range(3)  # what random numbers are for


class Trial(NamedTuple):
    """One trial. `position` of the comparison among the intervals, from 0; `practice` ones teach no
    method anything.

    `break_before`: the participant rests first.
    """

    number: int
    block: int
    condition: str
    level: float
    position: int
    practice: bool
    break_before: bool


class Schedule:
    """What one participant is presented in one session: ask for the `next` trial, report what came
    of it.
    """

    def __init__(self, experiment: Experiment, participant: str, session: str) -> None:
        self.experiment = experiment
        self._seeds = [
            experiment.file.seed,
            zlib.crc32(participant.encode()),
            zlib.crc32(session.encode()),
        ]
        self._number = 0  # of trials presented, with those that were not delivered
        self._since_break = 0
        self._practised = 0
        self._block = 0
        self._new_block = False
        blocks = experiment.blocks
        if experiment.file.block_order == "random":
            blocks = [blocks[i] for i in self._rng(BLOCKS, 0).permutation(len(blocks))]
        elif experiment.file.block_order == "balanced":
            blocks = [blocks[i] for i in balanced(len(blocks), _number_of(participant))]
        self._blocks = blocks
        self._methods = self._begun()

    def next(self) -> Trial | None:
        """The next trial, the same until it is reported; None at the end."""
        rng = self._rng(TRIALS, self._number)
        chosen = (
            self._practice(rng)
            if self._practised < self.experiment.file.practice
            else self._asked(rng)
        )
        if chosen is None:
            return None
        condition, level = chosen
        every = self.experiment.file.break_every
        return Trial(
            self._number + 1,
            self._block + 1,
            condition,
            self.experiment.condition(condition).available(level),
            int(rng.integers(self.experiment.file.trial.intervals)),
            self._practised < self.experiment.file.practice,
            self._new_block or bool(every and self._since_break >= every),
        )

    def report(self, trial: Trial, positive: bool | None) -> None:
        """What was answered to the trial that `next` gave; None where it was not delivered, and
        comes again.
        """
        self._number += 1
        self._since_break = 1 if trial.break_before else self._since_break + 1
        self._new_block = False
        if trial.practice:
            self._practised += 1
        elif positive is not None:
            self._methods[trial.condition].report(trial.level, positive)

    def stimuli(self, trial: Trial) -> list[Stimulus]:
        """What each interval presents."""
        condition = self.experiment.condition(trial.condition)
        shown = [condition.standard] * self.experiment.file.trial.intervals
        shown[trial.position] = condition.comparison(trial.level)
        return shown

    def _practice(self, rng: np.random.Generator) -> tuple[str, float]:
        condition = str(rng.choice(self._blocks[0]))
        level = self.experiment.file.practice_level
        assert level is not None  # or the file would have been refused
        return condition, level

    def _asked(self, rng: np.random.Generator) -> tuple[str, float] | None:
        """A condition of this block that is not done, at random, and what its method suggests; else
        of the next.
        """
        while True:
            asked = {
                name: level
                for name, m in self._methods.items()
                if (level := m.suggest()) is not None
            }
            if asked:
                condition = list(asked)[int(rng.integers(len(asked)))]
                return condition, asked[condition]
            if self._block + 1 >= len(self._blocks):
                return None
            self._block += 1
            self._new_block = True
            self._methods = self._begun()

    def _begun(self) -> dict[str, Method]:
        rng = self._rng(METHODS, self._block)
        return {name: method_of(self.experiment, name, rng) for name in self._blocks[self._block]}

    def _rng(self, purpose: int, number: int) -> np.random.Generator:
        """Random numbers of their own for every purpose, so that a crash changes none."""
        return np.random.default_rng([*self._seeds, purpose, number])


def balanced(count: int, number: int) -> list[int]:
    """The order of so many blocks for participant `number`, 1 and up: a Williams design (Aust. J.
    Sci. Res. A, 1949).

    Over `count` participants, or twice as many where that is odd, every block comes as often in
    every place. It also comes as often right after every other.
    """
    turn, row = divmod(number - 1, count)
    zigzag = [i // 2 + 1 if i % 2 else -i // 2 for i in range(count)]
    order = [(step + row) % count for step in zigzag]
    return order[::-1] if count % 2 and turn % 2 else order


def _number_of(participant: str) -> int:
    if found := re.search(r"[1-9][0-9]*$", participant):
        return int(found[0])
    said = (
        f'participant {participant}: block_order = "balanced" goes by the number at the end of the'
        " name"
    )
    raise BadInputError("bad_name", said, "Name participants P01, P02, and so on")


def positive_answer(trial: Trial, answer: int, intervals: int) -> bool:
    """Whether an answer, by its index, chose the comparison; for one interval, whether it was
    yes.
    """
    return answer == 0 if intervals == 1 else answer == trial.position


def correct_answer(trial: Trial, answer: int, intervals: int) -> bool | None:
    """Whether it was right; None where nothing is: without a difference, and for one interval."""
    if intervals == 1 or trial.level == 0.0:
        return None
    return (answer == trial.position) == (trial.level > 0.0)
