"""What to measure next: the few settings at which the leading models differ most, beside what stays
unknown.

Friction at one setting each, in one new session; `model.planning.design` chooses.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cholesky

from model.conditions import UNDRIVEN_HZ
from model.description import ModelDescription
from model.diagnosis.data import Measurements
from model.diagnosis.hypotheses import Candidate
from model.diagnosis.model_fit import Problem
from model.diagnosis.noise import SESSION_GAIN_STD
from model.diagnosis.priors import words
from model.diagnosis.space import Predictor
from model.diagnosis.where import Disagreement
from model.diagnosis.witness import FRICTION, WITNESSES
from model.diagnosis.workflow import Diagnosis
from model.effects import BY_NAME, Effect
from model.planning.design import Pool, Shown, design, leading, shown_by_one
from model.planning.separation import ALIKE, APART, separation
from model.support.arrays import Array

AGAINST = {witness.against for witness in WITNESSES if witness.against}
MOST = 6  # settings at a time
REPEATS = 5  # readings at each proposed setting
MOST_LEVELS = 4  # of voltage, load, speed and time
PRESENT_LEVELS = 12  # of frequency that a data set may add to the 1-2-5 steps
STEPS_HZ = (*(m * 10.0**e for e in range(6) for m in (1, 2, 5)), 1e6)


def next_experiments(diagnosis: Diagnosis, description: ModelDescription) -> list[dict[str, Any]]:
    """At most `MOST` settings, best first. Where no setting separates the two leading models,
    physical checks.

    `kind` is `setting` or `check`, `purpose` says in words what it is for. `separation` is what a
    setting adds, in chi^2, to the models' expected difference, given the settings before it.
    `lambda_now` and `lambda_after` are what is left of one leading model's prediction when the
    other is fitted. The first is with the present data, the second with all proposed settings
    measured (refitted, not extrapolated). `lambda_enough` suffices to name an effect. Without an
    explanation, the settings repeat where data and model disagree most.
    """
    findings = diagnosis.findings
    if findings is None:
        return []
    if diagnosis.name == "unexplained":
        return _repeats(diagnosis.data, findings.before)
    leaders = leading(findings)
    if len(leaders) < 2:
        return []
    problem, enough = findings.problem, APART
    friction = diagnosis.data.of(FRICTION)
    first, second = leaders[0][0], leaders[1][0]
    now = separation(problem, first, second)
    common: dict[str, Any] = {
        "purpose": f"tells {words(first.name)} from {words(second.name)}",
        "separates": [first.name, second.name],
        "lambda_now": now,
        "lambda_after": now,
        "lambda_enough": enough,
    }
    if not friction.any():  # settings are of friction
        return _checks((first, second), common)
    pool = _settings(_axes(diagnosis.data, [kind for c, _ in leaders for kind in c.kinds]))
    settings = pool.observations
    choices = design(diagnosis, pool, MOST, float(MOST)).choices
    if choices:
        chosen = settings.subset(np.array(sorted(choice.block for choice in choices)))
        common["lambda_after"] = separation(
            _extended(diagnosis.data, description, problem, chosen), first, second
        )
    if common["lambda_after"] < ALIKE:
        return [] if diagnosis.name == "no_discrepancy" else _checks((first, second), common)
    return [
        {
            "kind": "setting",
            **_setting(settings, choice.block),
            "repeats": REPEATS,
            "separation": choice.gain,
            **common,
        }
        for choice in choices
    ]


def out_of_sight(diagnosis: Diagnosis) -> list[dict[str, Any]]:
    """Effects that these data could not show at their usual size, and what would show each.

    `lambda_now` is below ALIKE, so that in less than half of such data sets a name would be earned.
    `lambda_after` is with the one `sweep` of friction in a new session that shows it best. Where
    that is below ALIKE too both are None, and the physical `check` is what is left.
    """
    findings = diagnosis.findings
    if findings is None:
        return []
    suspects, hidden = findings.verdict.suspects, findings.hypotheses.hidden
    faint = [name for name in hidden if hidden[name].usual < ALIKE and name not in suspects]
    kinds = [BY_NAME[name] for name in faint]
    shown: dict[str, Shown] = {}
    if kinds and diagnosis.data.of(FRICTION).any():
        pool = _sweeps(_axes(diagnosis.data, kinds))
        shown = shown_by_one(diagnosis, findings, pool, kinds)
        shown = {name: best for name, best in shown.items() if best.after >= ALIKE}
    return [
        {
            "name": kind.name,
            "lambda_now": hidden[kind.name].usual,
            "lambda_after": shown[kind.name].after if kind.name in shown else None,
            "sweep": _sweep(pool, shown[kind.name].block) if kind.name in shown else None,
            "check": kind.check,
        }
        for kind in kinds
    ]


def _repeats(data: Measurements, scan: Disagreement) -> list[dict[str, Any]]:
    """One measured setting from the middle of each region that disagrees, strongest first."""
    found: list[dict[str, Any]] = []
    for region in scan.certain[:MOST]:
        inside = np.ones(data.count, bool)
        for axis, low, high in zip(region.axes, region.low, region.high, strict=True):
            inside &= (data.columns[axis] >= low) & (data.columns[axis] <= high)
            inside &= data.driven if axis == "frequency_hz" else True
        rows = np.flatnonzero(inside)
        row = int(
            rows[np.lexsort([data.columns[axis][rows] for axis in region.axes])][rows.size // 2]
        )
        names = ("frequency_hz", "voltage_v", "normal_force_n", "speed_m_s")
        here = Measurements(
            {n: data.columns[n] for n in names if n in data.columns}, data.session, (), None, ""
        )
        found.append(
            {
                "kind": "setting",
                **_setting(here, row),
                "repeats": REPEATS,
                "purpose": (
                    "shows whether the disagreement comes back in a new session, and with another"
                    " finger"
                ),
            }
        )
    return found


def _axes(data: Measurements, kinds: Sequence[type[Effect]]) -> dict[str, list[float]]:
    """Levels of frequency and of what else these effects need, within reach of the data's friction;
    of voltage those above zero.
    """
    data = data.subset(data.of(FRICTION))
    c, driven = data.columns, data.driven
    # 0 where it is ignored
    present = np.unique(c["frequency_hz"][driven & (c["frequency_hz"] > 0.0)])
    frequencies = sorted({*STEPS_HZ, *(present.tolist() if present.size <= PRESENT_LEVELS else ())})
    axes = {
        "frequency_hz": frequencies,
        "voltage_v": [v for v in _levels(c["voltage_v"][driven]) if v > 0.0],
        "normal_force_n": _beyond(_levels(c["normal_force_n"]), 1.5),
    }
    if "speed_m_s" in c:
        speeds = _levels(c["speed_m_s"])
        axes["speed_m_s"] = _beyond(speeds, 2.0) if speeds[0] > 0.0 else speeds
    if any("time_s" in kind.needs for kind in kinds) and "time_s" in c:
        times = (c["time_s"].min(), np.median(c["time_s"]), c["time_s"].max())
        axes["time_s"] = [float(t) for t in np.unique(times)]
    return axes


def _settings(axes: Mapping[str, Sequence[float]]) -> Pool:
    """All combinations of levels, and every load and speed without voltage: a block each."""
    rest = list(product(*list(axes.values())[2:]))
    rows = list(product(*axes.values())) + [(UNDRIVEN_HZ, 0.0, *others) for others in rest]
    return _friction(list(axes), rows, np.arange(len(rows)))


def _sweeps(axes: Mapping[str, Sequence[float]]) -> Pool:
    """Sweeps of one axis, that of voltage from zero on, at the others' ends and middles: a block
    each. An axis of one level is not swept.
    """
    rows, block = list[tuple[float, ...]](), list[int]()
    for swept, own in axes.items():
        levels = [0.0, *own] if swept == "voltage_v" else own
        if len(levels) < 2:
            continue
        fixed = {name: _three(levels) for name, levels in axes.items() if name != swept}
        for others in product(*fixed.values()):
            at = dict(zip(fixed, others, strict=True))
            number = block[-1] + 1 if block else 0
            rows += [tuple((at | {swept: level})[name] for name in axes) for level in levels]
            block += [number] * len(levels)
    return _friction(list(axes), rows, np.array(block))


def _three(levels: Sequence[float]) -> list[float]:
    """The first, the middle and the last."""
    return [levels[i] for i in sorted({0, len(levels) // 2, len(levels) - 1})]


def _friction(
    names: Sequence[str], rows: Sequence[Sequence[float]], block: NDArray[np.intp]
) -> Pool:
    """Friction to be measured in one new session, row for row."""
    columns = dict(zip(names, np.array(rows, dtype=np.float64).T, strict=True))
    data = Measurements(columns, np.zeros(len(rows), np.intp), ("next",), None, "")
    return Pool(data, block, np.ones(int(block[-1]) + 1), REPEATS)


def _sweep(pool: Pool, block: int) -> dict[str, Any]:
    """What one block of `_sweeps` does."""
    columns = pool.observations.subset(pool.block == block).columns
    (axis,) = (name for name, values in columns.items() if np.ptp(values) > 0.0)
    at = {name: float(values[-1]) for name, values in columns.items() if name != axis}
    low, high = float(columns[axis].min()), float(columns[axis].max())
    settings = int(columns[axis].size)
    return {"axis": axis, "low": low, "high": high, "settings": settings, "at": at}


def _levels(values: Array) -> list[float]:
    """The distinct values where they are few, else quantiles; lowest and highest included, to three
    digits inside.
    """
    distinct = np.unique(values)
    if distinct.size <= MOST_LEVELS:
        return [float(v) for v in distinct]
    inner = np.quantile(distinct, np.linspace(0.0, 1.0, MOST_LEVELS), method="nearest")
    return sorted({float(v) if v in inner[[0, -1]] else float(f"{v:.3g}") for v in inner})


def _beyond(levels: list[float], factor: float) -> list[float]:
    """The levels and one more on either side."""
    return [float(f"{levels[0] / factor:.2g}"), *levels, float(f"{levels[-1] * factor:.2g}")]


def _extended(
    data: Measurements, description: ModelDescription, problem: Problem, chosen: Measurements
) -> Problem:
    """The data's problem with the chosen settings measured, `REPEATS` times each, in a new
    session.
    """
    noise, count = problem.noise, chosen.count
    usual = {"voltage_offset_v": 0.0}
    both = {
        name: np.concatenate(
            [values, chosen.columns.get(name, np.full(count, usual.get(name, np.median(values))))]
        )
        for name, values in data.columns.items()
        if name in (*chosen.columns, *AGAINST, "voltage_offset_v", "time_s")
    }
    session = np.concatenate([data.session, np.full(count, len(data.session_names))])
    waveform = (
        None if data.waveform is None else np.concatenate([data.waveform, np.full(count, "sine")])
    )
    effects_on = (
        None if data.effects_on is None else np.concatenate([data.effects_on, np.ones(count, bool)])
    )
    witness = (
        None if data.witness is None else np.concatenate([data.witness, np.full(count, FRICTION)])
    )
    finger = (
        None if data.finger is None else np.concatenate([data.finger, np.full(count, "sliding")])
    )
    extended = Measurements(
        both,
        session,
        (*data.session_names, "next"),
        waveform,
        "",
        effects_on,
        witness=witness,
        finger=finger,
    )
    own_std = np.full(count, np.median(noise.own_std[data.of(FRICTION)]) / np.sqrt(REPEATS))
    lower = np.zeros((extended.count, extended.count))
    lower[: data.count, : data.count] = noise.lower
    lower[data.count :, data.count :] = cholesky(
        np.diag(own_std**2) + SESSION_GAIN_STD**2, lower=True
    )
    wider = replace(
        noise,
        own_std=np.concatenate([noise.own_std, own_std]),
        lower=lower,
        blocks=(*noise.blocks, np.arange(data.count, extended.count)),
    )
    return Problem(
        Predictor(description, extended, problem.predictor.free), np.zeros(extended.count), wider
    )


def _setting(settings: Measurements, index: int) -> dict[str, float | None]:
    found: dict[str, float | None] = {
        name: float(values[index]) for name, values in settings.columns.items()
    }
    if found["voltage_v"] == 0.0:
        found["frequency_hz"] = None
    return found


def _checks(models: Sequence[Candidate], common: dict[str, Any]) -> list[dict[str, Any]]:
    """What to look at instead: the physical check of every effect of these models."""
    kinds = dict.fromkeys(kind for model in models for kind in model.kinds)
    return [{"kind": "check", "effect": kind.name, "check": kind.check, **common} for kind in kinds]
