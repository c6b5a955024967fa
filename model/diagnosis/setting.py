"""What every hypothesis is fitted to: rows, noise and sessions, as far as the residuals ask for it.

Outliers count for less, neighbours may be correlated, and an effect may be on in some sessions
only.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from model.description import ModelDescription
from model.diagnosis.audit import Audit
from model.diagnosis.data import Measurements
from model.diagnosis.evidence import remaining
from model.diagnosis.hypotheses import Candidate, candidate, fit_candidates
from model.diagnosis.model_fit import Problem
from model.diagnosis.noise import Noise, noise_of
from model.diagnosis.priors import LOG_ODDS
from model.diagnosis.readings import evidences
from model.diagnosis.sessions import inflation, names, split_sessions, unlike_sessions
from model.diagnosis.space import STRAY, Nuisance, Predictor, nuisances
from model.diagnosis.where import neighbour_correlation
from model.diagnosis.witness import CURRENT, FRICTION
from model.support.arrays import Array

OUTLIER = 4.5  # noise standard deviations from the most flexible model
MOST_OUTLYING = 0.15  # of all rows: more are no outliers
CORRELATED_P = 1e-3
MOST_CORRELATED = 0.8
OPEN = ("cof_off", "stray_capacitance_f")  # nobody expects a certain one
FAR_OFF = 2.5  # prior standard deviations of a nuisance that are worth a warning


class Setting(NamedTuple):
    """What the candidates are fitted to, with the base model's fit and that of every effect."""

    data: Measurements
    problem: Problem
    base: Candidate
    singles: list[Candidate]
    warnings: tuple[str, ...]


def fitted(description: ModelDescription, audit: Audit, progress: Callable[[str], None]) -> Setting:
    """Fit the base model and every effect alone."""
    progress("base model")
    base = _base(description, audit)
    setting = _with_singles(description, audit, base, progress)
    return setting._replace(warnings=(*setting.warnings, *setting.problem.noise.warnings))


def otherwise_read(description: ModelDescription, setting: Setting) -> dict[str, float]:
    """log evidence that nothing is missing, and the table is meant otherwise; see `readings`."""

    def nothing_missing(data: Measurements) -> float:
        read = _setting(description, data, setting.problem.noise, _start(description, data))
        return read.base.alone.log_evidence

    return evidences(setting.data, nothing_missing)


def nuisance_warnings(free: Sequence[Nuisance], chosen: Candidate) -> list[str]:
    """What of the finger's own parameters moved farther than anybody expects."""
    pairs = zip(free, chosen.fit.vector, strict=False)
    shifts = {n.name: n.in_std(float(x)) for n, x in pairs if n.name not in OPEN}
    check = "check the finger or the model file"
    return [
        f"{name} moved {shift:+.1f} prior standard deviations: {check}"
        for name, shift in shifts.items()
        if abs(shift) > FAR_OFF
    ]


def _base(description: ModelDescription, audit: Audit) -> Setting:
    """Fit the base model; again with outliers widened, and once more with neighbours correlated."""
    data, noise, warnings = audit.data, audit.noise, list[str]()
    assert noise is not None
    start = _start(description, data)
    setting = _setting(description, data, noise, start)
    left = _left(setting)
    outlying = np.abs(left) > OUTLIER
    widened = np.ones(data.count)
    if outlying.any() and outlying.sum() <= MOST_OUTLYING * data.count:
        widened = np.where(outlying, np.abs(left), 1.0)
        said = f"{int(outlying.sum())} rows lie more than {OUTLIER:g} sigma off every smooth model"
        warnings.append(f"{said}; given less weight")
        if (noisier := noise_of(data, 0.0, widened)) is not None:
            setting = _setting(description, data, noisier, start)
            left = _left(setting)
    correlation, p = neighbour_correlation(data, left)
    if p < CORRELATED_P and correlation > 0.0:
        rho = min(float(correlation), MOST_CORRELATED)
        said = f"noise of neighbouring rows is correlated ({rho:.2f})"
        warnings.append(f"{said}; taken into account")
        if (correlated := noise_of(data, rho, widened)) is not None:
            setting = _setting(description, data, correlated, start)
    return setting._replace(warnings=tuple(warnings))


def _with_singles(
    description: ModelDescription, audit: Audit, setting: Setting, progress: Callable[[str], None]
) -> Setting:
    """Every effect alone.

    Where sessions are unlike, also on in some of them only, whichever the data prefer.
    """

    def with_fits(s: Setting) -> Setting:
        kinds = [(kind,) for kind in audit.kinds]
        return s._replace(singles=fit_candidates(s.problem, s.base.fit, kinds, progress))

    def weight(s: Setting) -> float:
        fits = (s.base, *s.singles)
        return max(c.alone.log_evidence for c in fits) - s.problem.noise.log_determinant

    data, noise, start = setting.data, setting.problem.noise, setting.base.fit.vector
    chosen, why = setting, ""
    split = split_sessions(data, noise, setting.base.fit, setting.problem.discrepancy[-1])
    if unlike := unlike_sessions(data, _left(setting)):
        noisier = noise_of(data, noise.correlation, noise.inflation * inflation(data, unlike))
        assert noisier is not None
        chosen = _setting(description, data, noisier, start)
        named = ", ".join(data.session_names[s] for s in unlike)
        why = f"noisier than the others: session {named}; given less weight"
    chosen = with_fits(chosen)
    best = weight(chosen)
    cost = np.log(2.0 * len(audit.kinds)) + LOG_ODDS
    for rows in split or ():
        partial = with_fits(_setting(description, replace(data, effects_on=rows), noise, start))
        if weight(partial) - cost > best:
            best, chosen = weight(partial) - cost, partial
            why = f"sessions differ: an effect shows in {', '.join(names(data, rows))} only"
    return chosen._replace(warnings=(*setting.warnings, *([why] if why else [])))


def _setting(
    description: ModelDescription, data: Measurements, noise: Noise, start: Array
) -> Setting:
    problem = Problem(Predictor(description, data), data.observed, noise)
    base = candidate(problem, (), problem.fit((), start))
    return Setting(data, problem, base, [], ())


def _left(setting: Setting) -> Array:
    """Whitened residuals [n] of the base model beside a discrepancy of unknown shape."""
    found = setting.base.beside_discrepancy
    loose = found.amplitude * setting.problem.discrepancy[found.term]
    return remaining(setting.base.fit, found.scale, loose)


def _start(description: ModelDescription, data: Measurements) -> Array:
    """Where the base fit begins.

    Friction as without voltage, and no more stray capacitance than any current allows.
    """
    free = nuisances(description, data)
    start = np.zeros(len(free))
    undriven = data.of(FRICTION) & ~data.driven
    if undriven.any():
        off = np.median(data.observed[undriven]) - np.log(description.values.cof_off)
        start[0] = np.clip(off / free[0].log_std, -5, 5)
    mine = data.of(CURRENT)
    if STRAY in free and mine.any():
        columns = data.columns
        speed = 2.0 * np.pi * columns["frequency_hz"] * columns["voltage_v"]
        farads = (columns["current_a"] / speed)[mine].min()
        start[free.index(STRAY)] = np.clip(np.log(farads / STRAY.added) / STRAY.log_std, -5, 5)
    return start
