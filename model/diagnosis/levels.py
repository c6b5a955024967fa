"""Finds which rows repeat one another, and how much of their scatter is shared by a trial.

The noise has three levels. A *session* shares a gain, whose size is a prior. A *trial* is one touch
or stroke at one setting: its rows share a gain as well, whose size the data tell. What is left is a
*row's* own. Trials repeat one another where their settings are equal as commanded. Measured loads
are never quite equal. Then trials whose loads and speeds lie near each other repeat one another,
beside a slope over these. Sessions repeat one another where each reads a setting once. How the
trials of a setting change alike from row to row is signal, no noise.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from model.diagnosis.data import MEASURED, Measurements
from model.support.arrays import Array

NEAR = 0.15  # of the logarithm: loads and speeds of one setting, held by hand or by weights
MOSTLY = 0.8  # of all trials: so many different loads are measured ones
FEWEST_TRIALS = 12
FEWEST_DEGREES = 4  # of freedom, from which a scatter is believed
PASSES, SETTLED = 200, 1e-9  # of centring by two groupings in turn, in units of the values
LONG_AFTER = 10.0  # times the usual time between repeats: what drifts meanwhile is no noise

Numbers = NDArray[np.intp]


class Level(NamedTuple):
    """A variance, and its degrees of freedom."""

    variance: float
    degrees: int


class Levels(NamedTuple):
    """What the scatter of one witness's rows is made of.

    The variance of `row` is in units of the stated variance of the rows. That of `trial` is of the
    gain that a trial's rows share.
    """

    row: Level
    trial: Level

    @property
    def has_trials(self) -> bool:
        """Whether rows of a trial tell their own scatter from the trial's."""
        return min(self.row.degrees, self.trial.degrees) >= FEWEST_DEGREES


def trials(data: Measurements) -> Numbers:
    """A number per observation [n], equal for rows of one trial and witness.

    Told by the column `trial`, or, where loads are measured, by loads that agree to the last digit.
    """
    exact = data.replicate_groups()
    if trials_are_touches(data):
        assert data.trial is not None
        return _numbered(data.group, data.trial)
    if data.trial is not None:
        return _numbered(exact, data.trial)
    if loads_are_measured(data):
        return exact
    return np.arange(data.count)


def trials_are_touches(data: Measurements) -> bool:
    """Whether each trial of the file is at one setting, beside friction without voltage.

    What a file calls a trial may also be a plan that went through many settings: its rows share
    nothing.
    """
    if data.trial is None:
        return False
    driven = data.subset(data.driven)
    assert driven.trial is not None
    trial = _numbered(driven.group, driven.trial)
    together = _numbered(trial, driven.replicate_groups(held=()))
    return bool(np.unique(together).size == np.unique(trial).size > 1)


def has_touches(data: Measurements) -> bool:
    """Whether each trial is a touch at one setting: by the column `trial`, or by its load."""
    return trials_are_touches(data) or (data.trial is None and loads_are_measured(data))


def loads_are_measured(data: Measurements) -> bool:
    """Whether nearly every trial has a load of its own.

    A file that says which load was commanded, or which setting, answers that itself.
    """
    if data.setting is not None or any(name in data.columns for name in MEASURED.values()):
        return False
    touching = data.finger is None or bool((data.finger != "none").any())
    _, first = np.unique(data.replicate_groups(apart=False), return_index=True)
    loads = data.columns["normal_force_n"][first]
    return touching and first.size >= FEWEST_TRIALS and np.unique(loads).size >= MOSTLY * first.size


def rows_in_order(data: Measurements) -> list[Numbers]:
    """The rows of each session and witness in order of measurement, by `time_s` if there is one.

    Touches of a session follow one another. So where they overlap in `time_s`, it counts from the
    beginning of each, and they follow as in the file.
    """
    time_s = data.columns.get("time_s", np.arange(data.count, dtype=float))
    groups = [np.flatnonzero(data.group == g) for g in np.unique(data.group)]
    if has_touches(data):
        trial = np.unique(trials(data), return_inverse=True)[1].ravel()
        if any(_overlap(trial[rows], time_s[rows]) for rows in groups):
            _, first = np.unique(trial, return_index=True)
            return [rows[np.lexsort((time_s[rows], first[trial[rows]]))] for rows in groups]
    return [rows[np.argsort(time_s[rows], kind="stable")] for rows in groups]


def _overlap(trial: Numbers, time_s: Array) -> bool:
    """Whether a trial begins before another has ended."""
    begin, end = (np.full(trial.max() + 1, s * np.inf) for s in (1.0, -1.0))
    np.minimum.at(begin, trial, time_s)
    np.maximum.at(end, trial, time_s)
    here = np.unique(trial)
    here = here[np.argsort(begin[here], kind="stable")]
    return bool((np.maximum.accumulate(end[here])[:-1] >= begin[here][1:]).any())


def settings(data: Measurements, sessions_apart: bool = True) -> Numbers:
    """A number per observation [n], equal for those whose trials repeat one another."""
    if not loads_are_measured(data):
        return data.replicate_groups(sessions_apart=sessions_apart)
    apart = data.replicate_groups(held=(), sessions_apart=sessions_apart)
    for name in MEASURED:
        if name in data.columns:
            apart = _near(apart, data.columns[name])
    return apart


def levels(data: Measurements, values: Array, std: Array, inflation: Array | None = None) -> Levels:
    """Scatter of `values` [n] of such `std` [n] within trials, and of trials within settings.

    `inflation` [n]: times which rows are noisier than others, 1 if left out. The data are of one
    witness. Where a session hardly repeats a setting, and trials are touches, those of other
    sessions are its repeats, beside a gain of each session.
    """
    noisier = np.ones(data.count) if inflation is None else inflation
    told = _levels(data, values, std, noisier, sessions_apart=True)
    if told.row.degrees >= FEWEST_DEGREES or not has_touches(data):
        return told
    across = _levels(data, values, std, noisier, sessions_apart=False)
    return max(told, across, key=lambda found: found.row.degrees)


def of_trials(trial: Numbers, inflation: Array) -> Array:
    """How much noisier than others each row's trial is as a whole [n]: as its best row."""
    _, trial = np.unique(trial, return_inverse=True)
    least = np.full(trial.size, np.inf)
    np.minimum.at(least, trial.ravel(), inflation)
    return np.asarray(least[trial.ravel()])


def _levels(
    data: Measurements, values: Array, std: Array, inflation: Array, sessions_apart: bool
) -> Levels:
    trial = np.unique(trials(data), return_inverse=True)[1].ravel()
    first, setting = _settings_of_trials(data, trial, sessions_apart)
    place = _places(data, trial, sessions_apart)
    nearby = [np.log(data.columns[name]) for name in MEASURED if _positive(data, name)]
    rows = _rows_level(trial, setting, place, nearby, _Scaled(values, std**-2))

    in_trial = np.bincount(trial, std**-2)
    mean = np.bincount(trial, values * std**-2) / in_trial
    weight = of_trials(trial, inflation)[first] ** -2 if rows.degrees else in_trial.astype(float)
    session = np.zeros(0, np.intp) if sessions_apart else data.session[first]
    at_trial = [x[first] for x in nearby]
    between = _trials_level(setting[first], at_trial, session, _Scaled(mean, weight))
    if not rows.degrees:
        return Levels(between, Level(0.0, 0))
    # A trial's mean scatters by the trial's gain and by what its rows leave of theirs.
    left = rows.variance * float(np.mean(weight / in_trial))
    return Levels(rows, Level(max(between.variance - left, 0.0), between.degrees))


def _settings_of_trials(
    data: Measurements, trial: Numbers, sessions_apart: bool
) -> tuple[Numbers, Numbers]:
    """The row that stands for each trial [m], and the setting of each row's trial [n]."""
    _, first = np.unique(trial, return_index=True)
    setting = settings(data, sessions_apart)
    if not has_touches(data):
        # `time_s` is a session's here, and counts from the voltage in a touch.
        return first, _close_in_time(data, setting)
    by_drive = np.lexsort((~data.driven, trial))
    first = by_drive[np.searchsorted(trial[by_drive], np.arange(first.size))]
    return first, setting[first][trial]


def _places(data: Measurements, trial: Numbers, sessions_apart: bool) -> Numbers:
    """A number per row [n], equal for rows of one condition that come equally late in their
    trials.
    """
    condition = data.replicate_groups(held=(), sessions_apart=sessions_apart)
    time_s = data.columns.get("time_s", np.arange(data.count, dtype=float))
    return _numbered(condition, _ranks(_numbered(trial, condition), time_s))


def _ranks(group: Numbers, time_s: Array) -> Numbers:
    """The place of each row in its group [n], by time."""
    place = np.zeros(group.size, np.intp)
    order = np.lexsort((time_s, group))
    starts = np.flatnonzero(np.diff(group[order], prepend=-1))
    place[order] = np.arange(group.size) - np.repeat(starts, np.diff([*starts, group.size]))
    return place


def _rows_level(
    trial: Numbers, setting: Numbers, place: Numbers, nearby: list[Array], scaled: _Scaled
) -> Level:
    """Scatter within trials, beside what the trials of a setting share from place to place.

    A setting that one trial reads gives no replicate: what changes in that trial may be the touch.
    """
    cell, weight = _numbered(setting, place), scaled.weight
    beyond = scaled.centred(trial, cell)
    changes = scaled.values - beyond  # more of the force shows in one place than in another
    columns = [_Scaled(x, weight).centred(setting) * changes for x in nearby]
    columns = [_Scaled(x, weight).centred(trial, cell) for x in columns]
    beyond, spent = _Scaled(beyond, weight).beside(columns)
    shared = np.unique(cell).size - np.unique(setting).size
    degrees = trial.size - np.unique(trial).size - shared - spent
    return _Scaled(beyond, weight).level(degrees)


def _trials_level(
    setting: Numbers, nearby: list[Array], session: Numbers, scaled: _Scaled
) -> Level:
    """Scatter within settings, beside slopes over each condition that differs among repeats.

    More friction is more of the force, which has another slope. `session`: of each trial, where
    repeats are of several.
    """
    left, weight = scaled.centred(setting), scaled.weight
    level = scaled.values - left
    near = [_Scaled(x, weight).centred(setting) for x in nearby]
    columns = [x * y for x in near for y in (np.ones(left.size), level - level.mean())]
    columns += [(session == s).astype(float) for s in np.unique(session)[1:]]
    columns = [_Scaled(x, weight).centred(setting) for x in columns]
    left, spent = _Scaled(left, weight).beside(columns)
    degrees = setting.size - np.unique(setting).size - spent
    return _Scaled(left, weight).level(degrees)


class _Scaled(NamedTuple):
    """Values [n] and their weights [n]."""

    values: Array
    weight: Array

    def centred(self, *groups: Numbers) -> Array:
        """What no sum of a number per group explains of the values, by each of some groupings."""
        numbers = [np.unique(group, return_inverse=True)[1].ravel() for group in groups]
        totals = [np.bincount(group, self.weight) for group in numbers]
        left = self.values
        for _ in range(PASSES):
            before = left
            for group, total in zip(numbers, totals, strict=True):
                left = left - (np.bincount(group, left * self.weight) / total)[group]
            if len(groups) == 1 or np.abs(left - before).max() <= SETTLED:
                break
        return np.asarray(left)

    def beside(self, columns: list[Array]) -> tuple[Array, int]:
        """What no sum of these columns explains of the values, and how many degrees that cost."""
        columns = [x for x in columns if np.abs(x).max(initial=0.0) > 1e-9]
        if not columns:
            return self.values, 0
        root, x = np.sqrt(self.weight), np.stack(columns, axis=1)
        slopes, _, rank, _ = np.linalg.lstsq(x * root[:, None], self.values * root, rcond=1e-9)
        return self.values - x @ slopes, int(rank)

    def level(self, degrees: int) -> Level:
        """The mean weighted square of values that are centred, and its degrees of freedom."""
        if degrees <= 0:
            return Level(0.0, 0)
        return Level(float(np.sum(self.weight * self.values**2) / degrees), degrees)


def _positive(data: Measurements, name: str) -> bool:
    return name in data.columns and bool((data.columns[name] > 0.0).all())


def _near(group: Numbers, values: Array) -> Numbers:
    """Groups split where values lie farther apart than NEAR from the least of their part."""
    part = np.zeros(values.size, np.intp)
    for g in np.unique(group):
        rows = np.flatnonzero(group == g)
        rows = rows[np.argsort(values[rows], kind="stable")]
        number, least = 0, values[rows[0]]
        for row in rows:
            if values[row] > least * np.exp(NEAR):
                number, least = number + 1, values[row]
            part[row] = number
    return _numbered(group, part)


def _numbered(*keys: NDArray[np.generic]) -> Numbers:
    """A number per row, equal where all keys are."""
    numbers = [np.unique(key, return_inverse=True)[1].ravel() for key in keys]
    return np.unique(np.stack(numbers), axis=1, return_inverse=True)[1].ravel()


def _close_in_time(data: Measurements, group: Numbers) -> Numbers:
    """Groups of repeats [n], split where one comes long after the others."""
    time_s, later = data.columns.get("time_s"), np.zeros(data.count, np.intp)
    if time_s is None:
        return group
    for rows in (np.flatnonzero(group == g) for g in np.flatnonzero(np.bincount(group) > 2)):
        rows_by_time = rows[np.argsort(time_s[rows], kind="stable")]
        gap_s = np.diff(time_s[rows_by_time])
        if (gap_s > 0.0).any():
            usual_s = np.median(gap_s[gap_s > 0.0])
            later[rows_by_time[1:]] = np.cumsum(gap_s > LONG_AFTER * usual_s)
    return _numbered(group, later)
