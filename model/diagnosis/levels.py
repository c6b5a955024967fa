"""Finds which rows repeat one another, and how much of their scatter is shared by a trial.

Three levels of noise are told apart. A *session* shares a gain, whose size is a prior. A *trial*
is one touch or stroke at one setting: its rows share a gain as well, whose size the data tell.
What is left is a *row's* own. Trials repeat one another where their settings are equal as
commanded. Loads that were measured are never quite equal: then trials whose loads and speeds lie
near each other repeat one another, beside a slope over these. How the trials of a setting change
alike from row to row is signal, no noise.
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
LONG_AFTER = 10.0  # times the usual time between repeats: what drifts meanwhile is no noise

Numbers = NDArray[np.intp]


class Level(NamedTuple):
    """A variance, in units of the weights' inverse, and its degrees of freedom."""

    variance: float
    degrees: int


class Levels(NamedTuple):
    """What the scatter of one witness's rows is made of."""

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
    if data.trial is not None:
        return _numbered(exact, data.trial)
    if loads_are_measured(data):
        return exact
    return np.arange(data.count)


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


def settings(data: Measurements) -> Numbers:
    """A number per observation [n], equal for those whose trials repeat one another."""
    exact = data.replicate_groups()
    if not loads_are_measured(data):
        return exact
    apart = data.replicate_groups(held=())
    for name in MEASURED:
        if name in data.columns:
            apart = _near(apart, data.columns[name])
    return apart


def levels(data: Measurements, values: Array, std: Array) -> Levels:
    """Scatter of `values` [n] within trials, and of trials within settings, in units of `std` [n].

    The data are of one witness.
    """
    trial = np.unique(trials(data), return_inverse=True)[1].ravel()
    setting = _close_in_time(data, settings(data))
    in_trial = np.bincount(trial, std**-2)
    mean = np.bincount(trial, values * std**-2) / in_trial
    _, first = np.unique(trial, return_index=True)
    nearby = [np.log(data.columns[n])[first] for n in MEASURED if _positive(data, n)]
    between = _trials_level(setting[first], nearby, _Scaled(mean, in_trial.astype(float)))
    time_s = data.columns.get("time_s", np.arange(data.count, dtype=float))
    rows = _rows_level(trial, setting, time_s, _Scaled(values, std**-2))
    if not rows.degrees:
        return Levels(between, Level(0.0, 0))
    # A trial's mean scatters by the trial's gain and by what its rows leave of theirs.
    several = trial.size / first.size
    shared = max(between.variance - rows.variance, 0.0) / several
    return Levels(rows, Level(shared, between.degrees))


def _rows_level(trial: Numbers, setting: Numbers, time_s: Array, scaled: _Scaled) -> Level:
    """Scatter within trials, beside what the trials of a setting share from row to row.

    A setting that one trial reads tells nothing: what changes in that trial may be the touch.
    """
    place = np.zeros(trial.size, np.intp)  # of a row within its trial, by time
    order = np.lexsort((time_s, trial))
    starts = np.flatnonzero(np.diff(trial[order], prepend=-1))
    place[order] = np.arange(trial.size) - np.repeat(starts, np.diff([*starts, trial.size]))
    left = scaled.centred(trial)
    cell = _numbered(setting, place)
    left = _Scaled(left, scaled.weight).centred(cell)
    shared = np.unique(cell).size - np.unique(setting).size
    degrees = trial.size - np.unique(trial).size - shared
    return _Scaled(left, scaled.weight).level(degrees)


def _trials_level(setting: Numbers, nearby: list[Array], scaled: _Scaled) -> Level:
    """Scatter within settings, beside one slope over each condition that differs among repeats."""
    left, spent = scaled.centred(setting), 0
    columns = [_Scaled(x, scaled.weight).centred(setting) for x in nearby]
    columns = [x for x in columns if np.abs(x).max(initial=0.0) > 1e-9]
    if columns:
        root = np.sqrt(scaled.weight)
        x = np.stack(columns, axis=1)
        slopes, _, rank, _ = np.linalg.lstsq(x * root[:, None], left * root, rcond=1e-9)
        left, spent = left - x @ slopes, int(rank)
    degrees = setting.size - np.unique(setting).size - spent
    return _Scaled(left, scaled.weight).level(degrees)


class _Scaled(NamedTuple):
    """Values [n] and their weights [n]."""

    values: Array
    weight: Array

    def centred(self, group: Numbers) -> Array:
        """The values less their group's weighted mean."""
        _, group = np.unique(group, return_inverse=True)
        group = group.ravel()
        sums = np.bincount(group, self.values * self.weight)
        return np.asarray(self.values - (sums / np.bincount(group, self.weight))[group])

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
