"""Means over the trials of an experiment, as figure 3 of AliAbbasi et al. 2022 shows them.

From its strokes come friction, load and velocity over displacement. From its data file come steady
friction over frequency, and the electrostatic force that (31) infers from it.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import isfinite, nan
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from haptic_driver.errors import BadInputError
from haptic_driver.lab.strokes.file import KeptStroke, StrokeRow, read_strokes, strokes_path
from haptic_driver.signals import Array
from model.friction import electrostatic_force_n
from model.support.reading import read_text

BINS = 20  # of displacement, across the steady window
TOUCHING_N = 0.02  # a bin with less load has no friction
SAME_S = 0.05  # by which a row and its stroke may differ in the time of their window
NEEDED = (
    "frequency_hz",
    "voltage_v",
    "normal_force_n",
    "speed_m_s",
    "cof",
    "time_s",
    "session",
    "trial",
)


class Condition(NamedTuple):
    """What is the same in all trials that one figure shows."""

    voltage_v: float
    normal_force_n: float
    speed_m_s: float

    def __str__(self) -> str:
        """For a person."""
        speed = f"{1e3 * self.speed_m_s:g} mm/s"
        return f"{self.voltage_v:g} V, {self.normal_force_n:g} N, {speed}"


@dataclass(frozen=True)
class Curve:
    """Mean over trials and its standard error, by displacement [n]; NaN where too few were.

    `frequency_hz` is 0 without voltage.
    """

    frequency_hz: float
    trials: int
    displacement_m: Array
    cof: Array
    cof_sem: Array
    normal_force_n: Array
    normal_force_sem_n: Array
    velocity_m_s: Array
    velocity_sem_m_s: Array


@dataclass(frozen=True)
class Steady:
    """Steady friction by frequency [k]: means over trials, with standard errors.

    `printed_n` is the electrostatic force by (31) as printed, `corrected_n` as corrected; both NaN
    without trials without voltage, as `cof_off` is.
    """

    frequency_hz: Array
    trials: tuple[int, ...]
    cof: Array
    cof_sem: Array
    normal_force_n: Array
    printed_n: Array
    printed_sem_n: Array
    corrected_n: Array
    corrected_sem_n: Array
    cof_off: float
    cof_off_sem: float
    trials_off: int


@dataclass(frozen=True)
class StrokeMeans:
    """What a figure shows; `window_m` is the steady window by displacement, `left_out` the
    frequencies of which there is a single trial.
    """

    condition: Condition
    curves: tuple[Curve, ...]
    steady: Steady
    window_m: tuple[float, float]
    left_out: tuple[float, ...]
    about: dict[str, Any]


class _Trial(NamedTuple):
    frequency_hz: float
    condition: Condition
    cof: float
    normal_force_n: float
    stroke: KeptStroke


def stroke_means(data: Path, wanted: Mapping[str, float]) -> StrokeMeans:
    """Means of a data file and its strokes, under the condition of most frequencies among those
    `wanted`, by fields of `Condition`.

    BadInputError where there is no such file or condition, no frequency with two trials, or no
    steady window. The same where the strokes are those of other data.
    """
    rows = _rows(data)
    path = strokes_path(data)
    found = read_strokes(path)
    condition = _condition(data, rows, wanted)
    trials = _trials(rows, condition, found.strokes, path)
    by_frequency: dict[float, list[_Trial]] = {}
    for trial in trials:
        by_frequency.setdefault(trial.frequency_hz, []).append(trial)
    repeated = {f: some for f, some in sorted(by_frequency.items()) if len(some) > 1}
    if not any(repeated):
        said = f"{data}: no frequency was measured twice at {condition}: no standard error"
        raise BadInputError("one_trial", said, "Measure a plan with repeats or sessions")
    window_m = _window(path, trials)
    width_m = (window_m[1] - window_m[0]) / BINS
    curves = tuple(_curve(f, some, width_m) for f, some in repeated.items())
    left_out = tuple(f for f in sorted(by_frequency) if f not in repeated)
    steady = _steady(repeated)
    return StrokeMeans(condition, curves, steady, window_m, left_out, found.about)


def mean_and_error(values: Array) -> tuple[Array, Array]:
    """Mean over the first axis and its standard error, passing over NaN; NaN of less than two."""
    known = np.isfinite(values)
    count = known.sum(axis=0)
    n = np.where(count > 1, count, np.nan)
    mean = np.where(known, values, 0.0).sum(axis=0) / n
    square = np.where(known, (values - mean) ** 2, 0.0).sum(axis=0)
    return mean, np.sqrt(square / (n - 1.0) / n)


def _rows(data: Path) -> list[dict[str, str]]:
    """The sliding rows of a data file that have a friction."""
    reader = csv.DictReader(io.StringIO(read_text(data)))
    missing = [name for name in NEEDED if name not in (reader.fieldnames or ())]
    if missing:
        said = f"{data}: has no column {', '.join(missing)}"
        raise BadInputError("not_measured_data", said, "Give the CSV that haptic measure wrote")
    rows = [row for row in reader if row["cof"] and row.get("finger", "sliding") == "sliding"]
    for row in rows:
        _require_numbers(data, row)
    if not rows:
        said = f"{data}: holds no friction of a sliding finger"
        raise BadInputError("no_friction", said, "Measure a plan with [[points]]")
    return rows


def _require_numbers(data: Path, row: Mapping[str, str]) -> None:
    for name in NEEDED:
        try:
            number = float(row[name])
        except (ValueError, TypeError):
            number = nan
        if not isfinite(number):
            said = f"{data}: {name} {row[name]!r} is no number"
            raise BadInputError("bad_number", said, "Correct that cell, or leave out its line")


def _condition(
    data: Path, rows: Sequence[Mapping[str, str]], wanted: Mapping[str, float]
) -> Condition:
    frequencies: dict[Condition, set[float]] = {}
    for row in rows:
        told = _condition_of(row)
        is_sine = row.get("waveform") in (None, "", "sine")
        if told.voltage_v > 0.0 and is_sine and not float(row.get("voltage_offset_v") or 0.0):
            frequencies.setdefault(told, set()).add(float(row["frequency_hz"]))
    fitting = {
        told: some
        for told, some in frequencies.items()
        if all(np.isclose(getattr(told, name), value) for name, value in wanted.items())
    }
    if not fitting:
        known = "; ".join(str(told) for told in sorted(frequencies)) or "none with a sine voltage"
        asked = ", ".join(f"{name} {value:g}" for name, value in wanted.items()) or "a sine"
        said = f"{data}: nothing was measured with {asked}"
        raise BadInputError("no_such_condition", said, f"It has: {known}")
    return max(fitting, key=lambda told: (len(fitting[told]), told))


def _condition_of(row: Mapping[str, str]) -> Condition:
    return Condition(*(float(row[name]) for name in Condition._fields))


def _trials(
    rows: Sequence[Mapping[str, str]],
    condition: Condition,
    strokes: Sequence[KeptStroke],
    path: Path,
) -> list[_Trial]:
    """The rows under a condition, and those without voltage beside them, with their strokes."""
    by_row: dict[tuple[float, ...], list[KeptStroke]] = {}
    for stroke in strokes:
        by_row.setdefault(_key(stroke.row), []).append(stroke)
    trials = []
    for row in rows:
        told = _condition_of(row)
        if told not in (condition, condition._replace(voltage_v=0.0)):
            continue
        frequency_hz = float(row["frequency_hz"]) if told.voltage_v else 0.0
        key = (int(row["session"]), int(row["trial"]), frequency_hz, *told)
        near = [s for s in by_row.get(key, []) if abs(_time_s(s) - float(row["time_s"])) < SAME_S]
        if not near:
            said = f"{path}: has no stroke of session {key[0]}, trial {key[1]}, {frequency_hz:g} Hz"
            hint = "Give data and strokes of the same measurement, side by side"
            raise BadInputError("strokes_foreign", said, hint)
        load_n = float(row.get("measured_normal_force_n") or told.normal_force_n)
        trials.append(_Trial(frequency_hz, told, float(row["cof"]), load_n, near[0]))
    return trials


def _key(row: StrokeRow) -> tuple[float, ...]:
    frequency_hz = row.frequency_hz if row.voltage_v else 0.0
    told = Condition(row.voltage_v, row.commanded_normal_force_n, row.speed_m_s)
    return (row.session, row.trial, frequency_hz, *told)


def _time_s(stroke: KeptStroke) -> float:
    steady = stroke.samples["steady"] == 1
    return float(np.mean(stroke.samples["time_s"][steady])) if steady.any() else nan


def _window(path: Path, trials: Sequence[_Trial]) -> tuple[float, float]:
    begin_m, end_m = (
        float(np.median([getattr(trial.stroke.row, name) for trial in trials]))
        for name in ("steady_begin_m", "steady_end_m")
    )
    if not (isfinite(begin_m) and isfinite(end_m) and begin_m < end_m):
        said = f"{path}: tells no steady window, only {1e3 * begin_m:g} to {1e3 * end_m:g} mm"
        raise BadInputError("no_steady_window", said, "Give strokes that haptic measure wrote")
    return begin_m, end_m


def _curve(frequency_hz: float, trials: Sequence[_Trial], width_m: float) -> Curve:
    samples = [trial.stroke.samples for trial in trials]
    at_m: Array = np.concatenate([s["displacement_m"] for s in samples])
    first, last = (int(np.floor(end_m / width_m)) for end_m in (at_m.min(), at_m.max()))
    bins = last - first + 1
    lateral_n, load_n, velocity_m_s = (
        np.array([_binned(s["displacement_m"], s[name], width_m, first, bins) for s in samples])
        for name in ("lateral_force_n", "normal_force_n", "velocity_m_s")
    )
    cof = np.where(load_n > TOUCHING_N, lateral_n, np.nan) / load_n
    return Curve(
        frequency_hz,
        len(trials),
        np.asarray(width_m * (first + 0.5 + np.arange(bins)), np.float64),
        *mean_and_error(cof),
        *mean_and_error(load_n),
        *mean_and_error(velocity_m_s),
    )


def _binned(at_m: Array, values: Array, width_m: float, first: int, bins: int) -> Array:
    """Mean of the values in each bin; NaN where there is none."""
    place = np.floor(at_m / width_m).astype(int) - first
    count = np.bincount(place, minlength=bins)
    total = np.bincount(place, values, minlength=bins)
    return np.asarray(np.where(count > 0, total, np.nan) / np.maximum(count, 1))


def _steady(repeated: Mapping[float, Sequence[_Trial]]) -> Steady:
    off = np.array([trial.cof for trial in repeated.get(0.0, ())])
    cof_off, off_sem = (float(x) for x in mean_and_error(off)) if off.size else (nan, nan)
    driven = {f: some for f, some in repeated.items() if f > 0.0}
    found = [mean_and_error(np.array([t.cof for t in some])) for some in driven.values()]
    cof, sem = (np.array([float(pair[i]) for pair in found]) for i in (0, 1))
    load_n = np.array([np.mean([t.normal_force_n for t in some]) for some in driven.values()])
    relative = np.hypot(sem / cof, off_sem / cof_off)
    return Steady(
        np.array(list(driven)),
        tuple(len(some) for some in driven.values()),
        cof,
        sem,
        load_n,
        electrostatic_force_n("total_load", cof_off, cof, load_n),
        load_n * cof_off / cof * relative,
        electrostatic_force_n("applied_load", cof_off, cof, load_n),
        load_n * cof / cof_off * relative,
        cof_off,
        off_sem,
        off.size,
    )
