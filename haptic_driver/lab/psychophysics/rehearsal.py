"""Trying an experiment's design before anybody comes: simulated participants of known threshold,
without a rig.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from haptic_driver.config import texture_dirs
from haptic_driver.lab.psychophysics.analysis import Result, results_of
from haptic_driver.lab.psychophysics.apparatus import AssumedApparatus
from haptic_driver.lab.psychophysics.data import Row, SessionFiles
from haptic_driver.lab.psychophysics.description import Condition, Experiment, asked_levels
from haptic_driver.lab.psychophysics.functions import Psychometric
from haptic_driver.lab.psychophysics.run import PretendedParticipant, run_session
from haptic_driver.signals import WITHIN
from haptic_driver.textures.library import load
from haptic_driver.textures.reach import FLAG_SHARE, demand

UNBIASED_GUESS = 0.1  # of a simulated participant who says yes or no


class Found(NamedTuple):
    """How a condition's threshold was found: median over participants, its spread relative to the
    truth, and the mean number of trials. Two shares of participants follow: those whose 95 %
    interval holds the truth, and those whose answers hold one. `positive`: the mean share of
    positive answers, where one level alone is presented.
    """

    condition: str
    truth: float
    median: float
    relative_std: float
    trials: float
    held_by_interval: float
    fitted: float
    positive: float | None


class ReachedTexture(NamedTuple):
    """Friction that a texture asks for, and the shares of the screen on which that is out of
    reach.
    """

    texture: str
    asked_cof: tuple[float, float]
    share_below: float
    share_above: float

    @property
    def is_reached(self) -> bool:
        return self.share_below + self.share_above <= FLAG_SHARE

    def said(self) -> str:
        low, high = self.asked_cof
        said = f"{self.texture}: friction {low:.3g} to {high:.3g}"
        if self.is_reached:
            return f"{said}, all reached"
        return f"{said}; out of reach: {self.share_below:.1%} below, {self.share_above:.1%} above"


class Reached(NamedTuple):
    """What a rig reaches of one condition: frictions that may be asked, and the levels of those
    that can be reached.

    None where nobody knows: of levels by an optimiser of others. `textures`: the standard's and
    those of levels, of a condition of textures.
    """

    condition: str
    asked_cof: tuple[float, float] | None
    standard_is_reached: bool | None
    reached_levels: tuple[float, float] | None
    textures: tuple[ReachedTexture, ...] = ()

    def said(self) -> str:
        if self.asked_cof is None:
            return f"{self.condition}: unknown before it is presented"
        asked = (
            f"{self.condition}: friction {self.asked_cof[0]:.3g} to {self.asked_cof[1]:.3g} may be"
            " asked"
        )
        if not self.standard_is_reached:
            return f"{asked}; its standard is out of reach"
        if self.reached_levels is None:
            return f"{asked}; no level is reached"
        return (
            f"{asked}; levels {self.reached_levels[0]:.3g} to {self.reached_levels[1]:.3g} are"
            " reached"
        )


def reached(
    experiment: Experiment, condition: Condition, reachable_cof: tuple[float, float]
) -> Reached:
    """What a rig that reaches these frictions can present; as in delivery, 5 % beyond them count as
    reached.

    Raises BadInputError for a texture that is not there.
    """
    low, high = (1.0 - WITHIN) * reachable_cof[0], (1.0 + WITHIN) * reachable_cof[1]
    if condition.texture is not None:
        return _reached_textures(experiment, condition, (low, high))
    ends = asked_levels(experiment.file.method)
    if condition.cof is None or ends is None:
        return Reached(condition.name, None, None, None)
    lowest, highest = (condition.level_between(condition.cof, cof) for cof in (low, high))
    levels = max(ends[0], lowest), min(ends[1], highest)
    asked = [condition.comparison(level).cof or np.nan for level in ends]
    alone = experiment.file.trial.intervals == 1
    asked += [] if alone else [condition.cof]
    return Reached(
        condition.name,
        (min(asked), max(asked)),
        alone or low <= condition.cof <= high,
        levels if levels[0] <= levels[1] else None,
    )


def _reached_textures(
    experiment: Experiment, condition: Condition, within_cof: tuple[float, float]
) -> Reached:
    """The same of a texture and those that it is compared with."""
    names = dict.fromkeys(one.texture for one in condition.comparisons)
    alone = experiment.file.trial.intervals == 1
    if not alone and condition.texture is not None:
        names = {condition.texture: None, **names}
    found = {name: _reached_texture(name, within_cof) for name in names}
    levels = [one.level for one in condition.comparisons if found[one.texture].is_reached]
    ends = [cof for one in found.values() for cof in one.asked_cof]
    return Reached(
        condition.name,
        (min(ends), max(ends)),
        alone or found[condition.texture or ""].is_reached,
        (min(levels), max(levels)) if levels else None,
        tuple(found.values()),
    )


def _reached_texture(name: str, within_cof: tuple[float, float]) -> ReachedTexture:
    asked = demand(load(name, texture_dirs()).target, within_cof)
    ends = asked.cof_low, asked.cof_high
    return ReachedTexture(name, ends, asked.share_below, asked.share_above)


def pretended(
    experiment: Experiment, participant: str, session: str, seed: int = 0
) -> PretendedParticipant:
    """The simulated participant of an experiment's file, the same for the same names."""
    told, analysis = experiment.file.simulated, experiment.file.analysis
    guess = UNBIASED_GUESS if experiment.guess is None else experiment.guess
    function = Psychometric(analysis.form, told.threshold, told.slope, guess, told.lapse)
    return PretendedParticipant(
        function, [seed, *(zlib.crc32(name.encode()) for name in (participant, session))]
    )


def try_design(
    experiment: Experiment,
    participants: int,
    seed: int = 1,
    advance: Callable[[int], None] = lambda done: None,
    out: Path | None = None,
) -> list[Found]:
    """Run so many simulated participants through the experiment, each feeling exactly what is asked
    for. `out`: the folder that gets their sessions, as those of people.
    """
    names, task = [f"S{number:04d}" for number in range(1, participants + 1)], experiment.file.name
    kept: list[SessionFiles] = [
        _Remembered(name, task) if out is None else SessionFiles(out, name, "01", task)
        for name in names
    ]
    about = {"Experiment": experiment.file.model_dump(mode="json", exclude_none=True)}
    for done, files in enumerate(kept, start=1):
        run_session(
            experiment,
            files,
            AssumedApparatus(),
            pretended(experiment, files.participant, "01", seed),
            about,
        )
        advance(done)
    results = results_of(kept)
    truth = experiment.file.simulated.threshold
    return [
        _found(condition.name, truth, [r for r in results if r.condition == condition.name])
        for condition in experiment.file.condition
    ]


class _Remembered(SessionFiles):
    """A session of which nothing is written."""

    def __init__(self, participant: str, task: str) -> None:
        super().__init__(Path(), participant, "01", task)
        self._rows: list[Row] = []
        self._about: dict[str, Any] = {}

    def rows(self) -> list[Row]:
        return list(self._rows)

    def append(self, row: Row) -> None:
        self._rows.append(row)

    def describe(self, about: Mapping[str, Any]) -> None:
        self._about = dict(about)

    def described(self) -> dict[str, Any]:
        return self._about

    def write_participant(self) -> Path:
        return self.folder


def _found(condition: str, truth: float, results: list[Result]) -> Found:
    fits = [r.fit for r in results if r.fit is not None]
    thresholds = np.array([fit.threshold for fit in fits if not fit.why_none] or [np.nan])
    shares = [r.positive[0] for r in results if r.positive is not None]
    held = [fit.interval_95[0] <= truth <= fit.interval_95[1] for fit in fits]
    return Found(
        condition,
        truth,
        float(np.median(thresholds)),
        float(np.std(thresholds) / abs(truth)) if truth else np.nan,
        float(np.mean([r.trials for r in results])),
        float(np.mean(held)) if held else np.nan,
        sum(not fit.why_none for fit in fits) / len(results),
        float(np.mean(shares)) if shares else None,
    )
