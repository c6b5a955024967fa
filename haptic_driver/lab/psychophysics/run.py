"""A session: trials are presented, asked about and kept, until the schedule ends; it goes on where
it was stopped.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple, Protocol

import numpy as np

from haptic_driver.errors import BadInputError, HapticError
from haptic_driver.lab.psychophysics.apparatus import Apparatus
from haptic_driver.lab.psychophysics.data import Row, SessionFiles, mean_of
from haptic_driver.lab.psychophysics.delivery import why_not_delivered
from haptic_driver.lab.psychophysics.description import Experiment, Outside
from haptic_driver.lab.psychophysics.functions import Psychometric
from haptic_driver.lab.psychophysics.schedule import (
    Schedule,
    Trial,
    correct_answer,
    positive_answer,
)

SAME_ALL_ALONG = ("rig", "model", "surface_hash")  # of the sidecar's Rig, in one session


class Question(NamedTuple):
    """What is asked after a trial. `level` is for those who only pretend to feel: of what was felt,
    else as asked.
    """

    number: int
    text: str
    answers: Sequence[str]
    trial: Trial
    level: float


class Participant(Protocol):
    """Who answers. `answered_s`: when the last answer came, on CLOCK_MONOTONIC, where it was a
    marker; None where answers are no markers.
    """

    answered_s: float | None

    def wait(self, text: str) -> None:
        """Until the participant wants to go on."""

    def ask(self, question: Question) -> int:
        """The index of an answer."""

    def tell(self, text: str) -> None:
        """Show something, without waiting."""


class PretendedParticipant:
    """Answers by a psychometric function; the same in every run of a session."""

    answered_s: float | None = None

    def __init__(self, function: Psychometric, seed: Sequence[int] = (0,)) -> None:
        self._function = function
        self._seed = list(seed)

    def wait(self, text: str) -> None:
        """Never tired."""

    def tell(self, text: str) -> None:
        """Not impressed."""

    def ask(self, question: Question) -> int:
        """Positive as often as the function says; among wrong intervals any."""
        rng = np.random.default_rng([*self._seed, question.number])
        positive = rng.random() < float(self._function.at(question.level))
        others = [i for i in range(len(question.answers)) if i != question.trial.position]
        return question.trial.position if positive else int(rng.choice(others))


class Progress(NamedTuple):
    """How a session went: trials presented in all, of which this time, not delivered; whether it is
    over.
    """

    trials: int
    presented_now: int
    not_delivered: int
    done: bool


def run_session(
    experiment: Experiment,
    files: SessionFiles,
    apparatus: Apparatus,
    participant: Participant,
    about: Mapping[str, Any],
    kept: Callable[[Row], None] = lambda row: None,
) -> Progress:
    """Run what is left of a session; `about` goes into its sidecar. `kept` hears of each trial.

    BadInputError for a session that was begun with another file, HapticError when the rig cannot
    deliver a trial.
    """
    schedule, rows = resumed(experiment, files)
    trial = schedule.next()
    if trial is None:
        said = f"session {files.session} of {files.participant} is complete: {len(rows)} trials"
        raise BadInputError(
            "session_complete", said, "Give another --session, or another --participant"
        )
    _refuse_another_rig(files, about, begun=bool(rows))
    files.describe({"ExperimentHash": experiment.content_hash, **about})
    apparatus.mark("session begins" if not rows else "session goes on", _names(files))
    participant.wait(experiment.file.instructions or experiment.file.response.question)
    failed, before = 0, len(rows)
    try:
        while trial is not None:
            if trial.break_before:
                participant.wait("A break.")
            row = _presented(experiment, schedule, trial, apparatus, participant)
            files.append(row)
            rows.append(row)
            kept(row)
            failed = 0 if row.delivered else failed + 1
            if failed > experiment.file.delivery.retries:
                said = (
                    f"trial {trial.number}, {trial.condition} at level {trial.level:g}:"
                    f" {row.why_not_delivered}"
                )
                raise HapticError("not_delivered", said, _remedy(experiment, row))
            schedule.report(trial, row.positive if row.delivered else None)
            trial = schedule.next()
        apparatus.mark("session ends", _names(files))
        participant.tell("This is the end. Thank you.")
    finally:
        files.write_participant()
    return Progress(
        len(rows), len(rows) - before, sum(not row.delivered for row in rows), trial is None
    )


def _remedy(experiment: Experiment, row: Row) -> str:
    """What to change so that a trial as this one is delivered."""
    least_s = experiment.file.delivery.least_sliding_s
    felt = [one for one in (row.standard, row.comparison) if one is not None]
    if any(one.sliding_s < least_s for one in felt):
        return (
            f"Give the finger more time in [trial]: duration_s (now"
            f" {experiment.file.trial.duration_s:g}), or strokes; or ask for less than"
            f" {least_s:g} s in [delivery], least_sliding_s. Then run it again"
        )
    return "See [delivery]; check rig, load and speed, then run it again"


def resumed(experiment: Experiment, files: SessionFiles) -> tuple[Schedule, list[Row]]:
    """A session's schedule after what it has already, and that. BadInputError where the two do not
    belong together.
    """
    rows = files.rows()
    begun_with = files.described().get("ExperimentHash", experiment.content_hash)
    schedule = Schedule(experiment, files.participant, files.session)
    for row in rows:
        trial = schedule.next()
        if trial is not None and isinstance(experiment.file.method, Outside):
            trial = trial._replace(level=row.level)  # who knows whether it suggests the same again
        if trial is None or begun_with != experiment.content_hash or not _same(trial, row):
            said = f"{files.table}: trial {row.trial} is not one of {experiment.path} as it is now"
            raise BadInputError(
                "another_experiment", said, "Restore that file, or give another --session or --out"
            )
        schedule.report(trial, row.positive if row.delivered else None)
    return schedule, rows


def _refuse_another_rig(files: SessionFiles, about: Mapping[str, Any], *, begun: bool) -> None:
    """BadInputError where a session that has begun would go on with another rig or model."""
    before, now = files.described().get("Rig", {}), about.get("Rig", {})
    changed = [name for name in SAME_ALL_ALONG if before.get(name) != now.get(name)]
    if begun and changed:
        said = ", ".join(f"{name} {before.get(name)}, now {now.get(name)}" for name in changed)
        hint = "Start the daemon as before, or give another --session"
        raise BadInputError("another_rig", f"{files.sidecar}: begun with {said}", hint)


def _same(trial: Trial, row: Row) -> bool:
    placed = (trial.number, trial.condition, trial.position) == (
        row.trial,
        row.condition,
        row.position - 1,
    )
    return placed and math.isclose(trial.level, row.level, rel_tol=1e-6, abs_tol=1e-9)


def _presented(
    experiment: Experiment,
    schedule: Schedule,
    trial: Trial,
    apparatus: Apparatus,
    participant: Participant,
) -> Row:
    """Present a trial, ask, and say how it went."""
    file = experiment.file
    told: dict[str, object] = {
        "trial": trial.number,
        "condition": trial.condition,
        "level": trial.level,
    }
    began_s = apparatus.mark(
        "trial begins", told | {"position": trial.position + 1, "practice": trial.practice}
    )
    felts = apparatus.present(schedule.stimuli(trial), file.trial, file.delivery.settle_s)
    comparison, standard = (
        felts[trial.position],
        mean_of([*felts[: trial.position], *felts[trial.position + 1 :]]),
    )
    condition = experiment.condition(trial.condition)
    base_cof = condition.cof if standard is None else standard.felt_cof
    felt_level = (
        math.nan if base_cof is None else condition.level_between(base_cof, comparison.felt_cof)
    )
    asked_s = time.monotonic()
    level = felt_level if condition.cof is not None and math.isfinite(felt_level) else trial.level
    answer = participant.ask(
        Question(trial.number, file.response.question, experiment.answers, trial, level)
    )
    answered_s = participant.answered_s
    if answered_s is None:
        answered_s = time.monotonic()
        said = {"trial": trial.number, "answer": answer + 1, "response": experiment.answers[answer]}
        apparatus.mark("answered", said)
    onset_s, onset_error_s = apparatus.onset.onset_s, apparatus.onset.onset_error_s
    response_time_s = answered_s - (asked_s if onset_s is None else onset_s)
    intervals = file.trial.intervals
    correct = correct_answer(trial, answer, intervals)
    if correct is not None and (file.response.feedback or trial.practice):
        participant.tell("Right." if correct else "Wrong.")
    why_not = why_not_delivered(felts, file.delivery)
    row = Row(
        trial.number,
        trial.block,
        trial.condition,
        trial.practice,
        trial.level,
        felt_level,
        trial.position + 1,
        experiment.answers[answer],
        positive_answer(trial, answer, intervals),
        correct,
        response_time_s,
        math.nan if onset_error_s is None else onset_error_s,
        not why_not,
        why_not,
        began_s,
        standard,
        comparison,
    )
    apparatus.mark("trial ends", told | {"response": row.response, "delivered": row.delivered})
    return row


def _names(files: SessionFiles) -> dict[str, object]:
    return {"participant": files.participant, "session": files.session, "task": files.task}
