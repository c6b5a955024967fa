"""The diagnosis, step by step: audit, base fit, where, which effect, verdict, proof, next experiment.

Where no effect of the catalogue explains the data, a term is learned instead.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from model.description import ModelDescription
from model.diagnosis.data import Measurements
from model.diagnosis.fit import Problem
from model.diagnosis.force_sensor import force_sensor_evidence
from model.diagnosis.learned import LearnedTerm, learn
from model.diagnosis.naming import Candidate, candidate, fit_candidates, testable_effects, unseen
from model.diagnosis.noise import Noise, noise_of
from model.diagnosis.proof import Proof, prove
from model.diagnosis.rival import remaining
from model.diagnosis.sessions import inflation, names, split_sessions, unlike_sessions
from model.diagnosis.space import STRAY, Nuisance, Predictor, nuisances
from model.diagnosis.verdict import Verdict, decide
from model.diagnosis.weighing import Weighed
from model.diagnosis.where import Disagreement, disagreement, neighbour_correlation
from model.diagnosis.witness import CURRENT, FRICTION
from model.effects import CATALOGUE, Effect
from model.support.arrays import Array

FEWEST_ROWS = 12
FEWEST_DRIVEN = 8
OUTLIER = 4.5  # noise standard deviations from the most flexible model
CORRELATED_P = 1e-3
OPEN = ("cof_off", "stray_capacitance_f")  # nobody expects a certain one
FAR_OFF = 2.5  # prior standard deviations of a nuisance that are worth a warning
SESSIONS_NATS = 3.0  # by which an effect in some sessions must beat more noise there
LEADERS = 4  # rivals that take part in the held-out proof


@dataclass(frozen=True)
class Findings:
    """What was fitted and what it says; `before` scans the base model's residuals, `after` the chosen one's.

    `learned`: the empirical term that stands in where the verdict is `unexplained`, if there is any.
    """

    problem: Problem
    weighed: Weighed
    verdict: Verdict
    before: Disagreement
    after: Disagreement
    proof: Proof
    learned: LearnedTerm | None = None

    @property
    def chosen(self) -> Candidate:
        """The model that the data ask for: the verdict's, or that with the learned term if held-out data prove it."""
        return self.learned.candidate if self.learned is not None and self.learned.is_proved else self.verdict.chosen

    @property
    def adds_effects(self) -> bool:
        """Whether the corrected model carries what `chosen` has, named or learned."""
        return self.verdict.is_named or self.chosen is not self.verdict.chosen


@dataclass(frozen=True)
class Diagnosis:
    """Everything that one run found; without `findings` nothing could be tested, and `warnings` say why."""

    data: Measurements
    noise: Noise | None
    findings: Findings | None
    warnings: tuple[str, ...]
    seed: int

    @property
    def name(self) -> str:
        """The verdict's name."""
        return "not_testable" if self.findings is None else self.findings.verdict.verdict


def diagnose(
    description: ModelDescription, data: Measurements, seed: int = 0, progress: Callable[[str], None] = lambda _: None
) -> Diagnosis:
    """Run the whole workflow on one data set."""
    warnings = [f"{data.left_out} rows contradict Kramers and Kronig, and are left out"] if data.left_out else []
    noise = noise_of(data)
    kinds = testable_effects(data, description.effects)
    blocked = _blocked(data, noise, kinds)
    if noise is None or blocked:
        return Diagnosis(data, noise, None, (blocked,), seed)
    progress("base model")
    setting = _base(description, data, noise, warnings)
    untestable = [kind.name for kind in CATALOGUE if kind not in kinds]
    setting, singles = _fit_singles(description, setting, kinds, warnings, progress)
    data, problem, base = setting
    noise = problem.noise
    warnings += noise.warnings
    before = disagreement(data, noise, base.fit, base.bent, seed)
    hidden = {kind.name: unseen(problem, base, kind) for kind in kinds}
    weighed = Weighed(base, singles, untestable, hidden, force_sensor_evidence(problem, base))

    def scan(found: Candidate) -> Disagreement:
        return disagreement(data, noise, found.around, found.bent, seed)

    verdict = decide(problem, weighed, before, scan, progress)
    leaders = sorted(singles, key=lambda c: -c.alone.log_evidence)[:LEADERS]
    scale = verdict.chosen.beside_discrepancy.scale
    proof = prove(description, data, noise, verdict.chosen, leaders, scale, seed, progress)
    findings = Findings(problem, weighed, verdict, before, scan(verdict.chosen), proof)
    if verdict.verdict == "unexplained":
        findings = replace(findings, learned=learn(description, data, problem, base, seed, progress))
    if findings.learned is not None and findings.learned.is_proved:
        findings = replace(findings, after=scan(findings.chosen), proof=findings.learned.proof)
    warnings += _nuisance_warnings(problem.predictor.free, findings.chosen)
    return Diagnosis(data, noise, findings, tuple(warnings), seed)


def _blocked(data: Measurements, noise: Noise | None, kinds: list[type[Effect]]) -> str:
    """Why these data can test nothing; empty where they can."""
    if noise is None:
        return "no cof_std and no replicates: without a noise, no discrepancy can be told from chance"
    driven = data.driven
    if data.count < FEWEST_ROWS or driven.sum() < FEWEST_DRIVEN:
        return f"{data.rows} rows, {int(driven.sum())} with voltage: {FEWEST_ROWS} and {FEWEST_DRIVEN} are needed"
    if not kinds:
        return "every effect that these data could show is in the model already"
    return ""


class _Setting(NamedTuple):
    """What the candidates are fitted to, with the base model's fit."""

    data: Measurements
    problem: Problem
    base: Candidate


def _setting(description: ModelDescription, data: Measurements, noise: Noise, start: Array) -> _Setting:
    problem = Problem(Predictor(description, data), data.observed, noise)
    return _Setting(data, problem, candidate(problem, (), problem.fit((), start)))


def _left(setting: _Setting) -> Array:
    """Whitened residuals [n] of the most flexible model: the base beside a discrepancy of unknown shape."""
    found = setting.base.beside_discrepancy
    return remaining(setting.base.fit, found.scale, found.amplitude * setting.problem.discrepancy[found.term])


def _fit_singles(
    description: ModelDescription,
    setting: _Setting,
    kinds: list[type[Effect]],
    warnings: list[str],
    progress: Callable[[str], None],
) -> tuple[_Setting, list[Candidate]]:
    """Every effect alone; where sessions are unlike, also on in some of them only, whichever the data prefer."""

    def fitted(s: _Setting) -> list[Candidate]:
        return fit_candidates(s.problem, s.base.fit, [(kind,) for kind in kinds], progress)

    def weight(s: _Setting, fits: list[Candidate]) -> float:
        return max(c.alone.log_evidence for c in fits) - s.problem.noise.log_determinant

    data, noise = setting.data, setting.problem.noise
    chosen, why = setting, ""
    split = split_sessions(data, noise, setting.base.fit, setting.problem.discrepancy[-1])
    if unlike := unlike_sessions(data, _left(setting)):
        noisier = noise_of(data, noise.correlation, noise.inflation * inflation(data, unlike))
        assert noisier is not None
        chosen = _setting(description, data, noisier, setting.base.fit.vector)
        why = f"noisier than the others: session {', '.join(data.session_names[s] for s in unlike)}; given less weight"
    singles = fitted(chosen)
    best = max(weight(chosen, singles), weight(chosen, [chosen.base]))
    for rows in split or ():
        partial = _setting(description, replace(data, effects_on=rows), noise, setting.base.fit.vector)
        fits = fitted(partial)
        cost = np.log(2.0 * len(kinds)) + SESSIONS_NATS
        if weight(partial, fits) - cost > best:
            best, chosen, singles = weight(partial, fits) - cost, partial, fits
            why = f"sessions differ: an effect shows in {', '.join(names(data, rows))} only"
    if why:
        warnings.append(why)
    return chosen, singles


def _base(description: ModelDescription, data: Measurements, noise: Noise, warnings: list[str]) -> _Setting:
    """Fit the base model; once more with outliers widened and neighbours correlated, where residuals show either."""
    start = _start(description, data)
    inflation, correlation = np.ones(data.count), 0.0
    for attempt in range(3):
        setting = _setting(description, data, noise, start)
        left = _left(setting)
        if attempt == 2:
            break
        outlying = np.abs(left) > OUTLIER
        if outlying.any() and outlying.sum() <= 0.15 * data.count and attempt == 0:
            inflation = np.where(outlying, np.abs(left), 1.0) * inflation
            warnings.append(
                f"{int(outlying.sum())} rows lie more than {OUTLIER:g} sigma off every smooth model; given less weight"
            )
        rho = 0.0 if correlation else _neighbour_correlation(data, left)  # of what is left once it was taken out: no
        if rho:
            correlation = rho
            warnings.append(f"noise of neighbouring rows is correlated ({rho:.2f}); taken into account")
        if not outlying.any() and not rho:
            break
        again = noise_of(data, correlation, inflation)
        if again is None:
            break
        noise = again
    return setting


def _start(description: ModelDescription, data: Measurements) -> Array:
    """Where the base fit begins: friction as without voltage, and no more stray capacitance than any current allows."""
    free = nuisances(description, data)
    start = np.zeros(len(free))
    undriven = data.of(FRICTION) & ~data.driven
    if undriven.any():
        off = np.median(data.observed[undriven]) - np.log(description.values.cof_off)
        start[0] = np.clip(off / free[0].log_std, -5, 5)
    if STRAY in free:
        mine = data.of(CURRENT)
        farads = data.columns["current_a"] / (2.0 * np.pi * data.columns["frequency_hz"] * data.columns["voltage_v"])
        if mine.any():
            start[free.index(STRAY)] = np.clip(np.log(farads[mine].min() / STRAY.added) / STRAY.log_std, -5, 5)
    return start


def _neighbour_correlation(data: Measurements, residual: Array) -> float:
    correlation, p = neighbour_correlation(data, residual)
    return float(np.clip(correlation, 0.0, 0.8)) if p < CORRELATED_P and correlation > 0.0 else 0.0


def _nuisance_warnings(free: Sequence[Nuisance], chosen: Candidate) -> list[str]:
    shifts = {n.name: n.in_std(float(x)) for n, x in zip(free, chosen.fit.vector, strict=False)}
    return [
        f"{name} moved {shift:+.1f} prior standard deviations: check the finger or the model file"
        for name, shift in shifts.items()
        if name not in OPEN and abs(shift) > FAR_OFF
    ]
