"""From a folder of results to thresholds: a psychometric function per participant and condition."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.special import stdtrit

from haptic_driver.config import parse
from haptic_driver.errors import BadInputError
from haptic_driver.lab.psychophysics.data import Row, SessionFiles, sessions
from haptic_driver.lab.psychophysics.description import Experiment, ExperimentFile, Staircase
from haptic_driver.lab.psychophysics.fit import Fit, fit
from haptic_driver.lab.psychophysics.methods import StaircaseMethod, converges_at


class Course(NamedTuple):
    """Trials in order: levels [n], and whether the answer was positive [n]."""

    levels: list[float]
    positive: list[bool]


class Group(NamedTuple):
    """Thresholds of some participants in one condition, with 95 % intervals, and their mean with
    its interval by Student's t.
    """

    task: str
    condition: str
    participants: list[str]
    thresholds: list[float]
    intervals_95: list[tuple[float, float]]
    mean: float
    mean_95: tuple[float, float]
    axis: str


@dataclass(frozen=True)
class Result:
    """One participant's answers to one condition. `fit` is None where they are too few; `why_none`
    says why there is no threshold.

    `left_out`: why, of each trial that was not delivered. `staircase`: mean of the reversals of
    each session's staircase, and the share of positive answers at which it comes to rest. None for
    other methods, and where reversals are those of the end of its range. `positive`: where one
    level alone was presented, the share of positive answers and its 95 % interval. `notes`: what
    not to rely on. `axis`: what a level is, with its unit. `courses`: of each session the levels of
    its delivered trials in order, and which were answered positively.
    """

    participant: str
    task: str
    condition: str
    trials: int
    left_out: tuple[str, ...]
    fit: Fit | None
    why_none: str = ""
    staircase: tuple[float, float] | None = None
    positive: tuple[float, float, float] | None = None
    notes: tuple[str, ...] = ()
    axis: str = "level"
    courses: tuple[Course, ...] = ()

    def numbers(self) -> dict[str, str | float]:
        """A line of the table of thresholds."""
        found: dict[str, str | float] = {
            "participant": self.participant,
            "task": self.task,
            "condition": self.condition,
            "trials": self.trials,
            "left_out": len(self.left_out),
        }
        unknown = ("threshold", "threshold_low", "threshold_high", "slope", "guess", "lapse")
        found |= dict.fromkeys((*unknown, "deviance"), "") | {"why_none": self.why_none}
        if self.fit is not None:
            ends = zip(self.fit.interval_95, self.fit.open_ends, strict=True)
            low, high = ("" if is_open else end for end, is_open in ends)
            found |= {"threshold_low": low, "threshold_high": high}
            if not self.fit.why_none:
                function = self.fit.function
                found |= {"threshold": function.threshold, "slope": function.slope}
                found |= {"guess": function.guess, "lapse": function.lapse}
            found |= {"deviance": self.fit.deviance}
        mean, share = self.staircase or ("", "")
        found |= {"reversals_mean": mean, "reversals_at": share}
        share, low, high = self.positive or ("", "", "")
        found |= {"positive": share, "positive_low": low, "positive_high": high}
        return found | {"notes": "; ".join(self.notes)}


def analyse(folder: Path, *, as_felt: bool = False) -> list[Result]:
    """Every participant and condition of a folder of results, over all sessions; `as_felt`: over
    measured levels.

    Practice and trials that were not delivered are left out. BadInputError where there are no
    results.
    """
    found = sessions(folder)
    if not found:
        raise BadInputError(
            "no_results", f"{folder}: holds no session", "Give the --out of haptic experiment run"
        )
    return results_of(found, as_felt=as_felt)


def results_of(found: Sequence[SessionFiles], *, as_felt: bool = False) -> list[Result]:
    """Every participant and condition of some sessions."""
    experiments: dict[tuple[str, str], Experiment] = {}
    rows: dict[tuple[str, str, str], list[list[Row]]] = defaultdict(list)
    for files in found:
        experiment = experiment_of(files)
        experiments[files.participant, files.task] = experiment
        told = [row for row in files.rows() if not row.practice]
        for condition in experiment.file.condition:
            rows[files.participant, files.task, condition.name].append(
                [r for r in told if r.condition == condition.name]
            )
    return [
        _result(experiments[participant, task], participant, condition, by_session, as_felt)
        for (participant, task, condition), by_session in rows.items()
    ]


def groups_of(results: Sequence[Result]) -> list[Group]:
    """The mean of each condition in which two participants or more have a threshold."""
    found = []
    for task, condition in dict.fromkeys((r.task, r.condition) for r in results):
        own = [
            (r.participant, r.fit, r.axis)
            for r in results
            if (r.task, r.condition) == (task, condition) and r.fit and not r.why_none
        ]
        if len(own) < 2:
            continue
        names, fits, axes = (list(part) for part in zip(*own, strict=True))
        values = np.array([fit.threshold for fit in fits])
        mean, spread = float(values.mean()), float(values.std(ddof=1))
        half = float(stdtrit(values.size - 1, 0.975)) * spread / np.sqrt(values.size)
        ends = [fit.interval_95 for fit in fits]
        interval = (mean - half, mean + half)
        found.append(Group(task, condition, names, values.tolist(), ends, mean, interval, axes[0]))
    return found


def experiment_of(files: SessionFiles) -> Experiment:
    """The experiment that a session was run with, from its sidecar."""
    said = files.described()
    if "Experiment" not in said:
        message = f"{files.sidecar}: does not say which experiment this was"
        raise BadInputError("bad_session", message, "Restore it from a copy")
    where = f"{files.sidecar}: Experiment"
    return Experiment(
        parse(ExperimentFile, said["Experiment"], where),
        files.sidecar,
        said.get("ExperimentHash", ""),
    )


def _result(
    experiment: Experiment,
    participant: str,
    condition: str,
    by_session: Sequence[Sequence[Row]],
    as_felt: bool,
) -> Result:
    every = [row for rows in by_session for row in rows]
    used = [row for row in every if row.delivered]
    left_out = tuple(row.why_not_delivered for row in every if not row.delivered)
    levels = [row.felt_level if as_felt else row.level for row in used]
    found, why_none, notes = None, "", list[str]()
    try:
        kept = [i for i, level in enumerate(levels) if np.isfinite(level)]
        found = fit(
            [levels[i] for i in kept],
            [used[i].positive for i in kept],
            experiment.file.analysis.form,
            experiment.guess,
        )
        why_none, notes = found.why_none, list(found.notes)
    except BadInputError as error:
        why_none = error.message
    settings, staircase = experiment.file.method, None
    if isinstance(settings, Staircase):
        staircase, note = _staircase(settings, by_session)
        notes += [note] if note else []
    return Result(
        participant,
        experiment.file.name,
        condition,
        len(used),
        left_out,
        found,
        why_none,
        staircase,
        _positive(used),
        tuple(notes),
        experiment.condition(condition).axis,
        tuple(_course(rows) for rows in by_session),
    )


def _positive(used: Sequence[Row]) -> tuple[float, float, float] | None:
    """The share of positive answers and its 95 % interval (Wilson), of trials at one level."""
    if len({row.level for row in used}) != 1:
        return None
    from scipy.stats import binomtest  # noqa: PLC0415  (slow to import)

    count = sum(row.positive for row in used)
    low, high = binomtest(count, len(used)).proportion_ci(method="wilson")
    return count / len(used), float(low), float(high)


def _course(rows: Sequence[Row]) -> Course:
    delivered = [row for row in rows if row.delivered]
    return Course([row.level for row in delivered], [row.positive for row in delivered])


def _staircase(
    settings: Staircase, by_session: Sequence[Sequence[Row]]
) -> tuple[tuple[float, float] | None, str]:
    """Mean over sessions of what each staircase says itself, and where it comes to rest; or why
    there is none.
    """
    estimates, at_end = [], ""
    for rows in by_session:
        staircase = StaircaseMethod(settings)
        for row in rows:
            if row.delivered:
                staircase.report(row.level, row.positive)
        at_end = at_end or staircase.at_end
        if staircase.estimate is not None:
            estimates.append(staircase.estimate)
    share = converges_at(settings)
    if at_end or share is None or not estimates:
        return None, at_end
    return (float(np.mean(estimates)), share), ""
