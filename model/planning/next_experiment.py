"""What to measure next: the few settings at which the leading models differ most, beside what stays
unknown.

Friction at one setting each, in one new session; `model.planning.design` chooses.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np
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
from model.planning.design import Pool, design, leading
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
    settings = _settings(diagnosis.data.subset(friction), [c for c, _ in leaders])
    pool = Pool(settings, np.arange(settings.count), np.ones(settings.count), REPEATS)
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


def _settings(data: Measurements, leaders: Sequence[Candidate]) -> Measurements:
    """All combinations of levels, and every load and speed without voltage; one row each."""
    c = data.columns
    driven = data.driven
    needs = {need for candidate in leaders for kind in candidate.kinds for need in kind.needs}
    # 0 where it is ignored
    present = np.unique(c["frequency_hz"][driven & (c["frequency_hz"] > 0.0)])
    frequencies = sorted({*STEPS_HZ, *(present.tolist() if present.size <= PRESENT_LEVELS else ())})
    voltages = [v for v in _levels(c["voltage_v"][driven]) if v > 0.0]
    axes: dict[str, list[float]] = {"normal_force_n": _beyond(_levels(c["normal_force_n"]), 1.5)}
    if "speed_m_s" in c:
        speeds = _levels(c["speed_m_s"])
        axes["speed_m_s"] = _beyond(speeds, 2.0) if speeds[0] > 0.0 else speeds
    if "time_s" in needs:
        axes["time_s"] = [
            float(t)
            for t in np.unique([c["time_s"].min(), np.median(c["time_s"]), c["time_s"].max()])
        ]
    rest = list(product(*axes.values()))
    rows = [(f, v, *others) for f in frequencies for v in voltages for others in rest]
    rows += [(UNDRIVEN_HZ, 0.0, *others) for others in rest]
    table = np.array(rows, dtype=np.float64)
    columns = dict(zip(("frequency_hz", "voltage_v", *axes), table.T, strict=True))
    return Measurements(columns, np.zeros(len(rows), np.intp), ("next",), None, "")


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
