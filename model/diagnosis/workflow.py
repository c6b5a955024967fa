"""The diagnosis, step by step: audit, base fit, where, which effect, verdict, proof, next experiment."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from model.description import ModelDescription
from model.diagnosis.data import Array, Measurements
from model.diagnosis.fit import Problem
from model.diagnosis.naming import Candidate, candidate, fit_candidates, testable_effects
from model.diagnosis.noise import Noise, noise_of
from model.diagnosis.proof import Proof, prove
from model.diagnosis.rival import features
from model.diagnosis.space import NUISANCES, Predictor
from model.diagnosis.verdict import Verdict, Weighed, decide
from model.diagnosis.where import Disagreement, disagreement, neighbour_correlation
from model.effects import CATALOGUE

FEWEST_ROWS = 12
FEWEST_DRIVEN = 8
OUTLIER = 4.5  # noise standard deviations from the most flexible model
CORRELATED_P = 1e-3
LEADERS = 4  # rivals that take part in the held-out proof


@dataclass(frozen=True)
class Diagnosis:
    """Everything that one run found; `after` is the scan of the chosen model's residuals."""

    data: Measurements
    noise: Noise | None
    verdict: Verdict | None
    weighed: Weighed | None
    before: Disagreement | None
    after: Disagreement | None
    proof: Proof | None
    problem: Problem | None
    discrepancy: list[Array] | None
    warnings: tuple[str, ...]
    seed: int

    @property
    def name(self) -> str:
        """The verdict's name."""
        return "not_testable" if self.verdict is None else self.verdict.verdict


def diagnose(
    description: ModelDescription, data: Measurements, seed: int = 0, progress: Callable[[str], None] = lambda _: None
) -> Diagnosis:
    """Run the whole workflow on one data set."""
    warnings: list[str] = []
    noise = noise_of(data)
    blocked = _blocked(data, noise)
    if noise is None or blocked:
        return Diagnosis(data, noise, None, None, None, None, None, None, None, (blocked,), seed)
    progress("base model")
    noise, problem, discrepancy, base = _base(description, data, noise, warnings)
    warnings += noise.warnings
    before = disagreement(data, noise, base.fit, seed)

    kinds = testable_effects(data, description.effects)
    untestable = [kind.name for kind in CATALOGUE if kind not in kinds]
    singles = fit_candidates(problem, discrepancy, base.fit, [(kind,) for kind in kinds], progress)
    weighed = Weighed(base, singles, untestable)

    def scan(found: Candidate) -> Disagreement:
        return disagreement(data, noise, found.fit, seed)

    verdict = decide(data, problem, discrepancy, weighed, before, scan, progress)
    leaders = sorted(singles, key=lambda c: -c.alone.log_evidence)[:LEADERS]
    proof = prove(description, data, noise, verdict.chosen, leaders, seed, progress)
    warnings += _nuisance_warnings(verdict.chosen)
    return Diagnosis(
        data, noise, verdict, weighed, before, scan(verdict.chosen), proof, problem, discrepancy, tuple(warnings), seed
    )


def _blocked(data: Measurements, noise: Noise | None) -> str:
    """Why these data can test nothing; empty where they can."""
    if noise is None:
        return "no cof_std and no replicates: without a noise, no discrepancy can be told from chance"
    driven = data.driven
    if data.count < FEWEST_ROWS or driven.sum() < FEWEST_DRIVEN:
        return f"{data.count} rows, {int(driven.sum())} with voltage: {FEWEST_ROWS} and {FEWEST_DRIVEN} are needed"
    return ""


def _base(
    description: ModelDescription, data: Measurements, noise: Noise, warnings: list[str]
) -> tuple[Noise, Problem, list[Array], Candidate]:
    """Fit the base model; once more with outliers widened and neighbours correlated, where residuals show either."""
    predictor, log_cof = Predictor(description, data), np.log(data.columns["cof"])
    start = np.zeros(len(NUISANCES))
    start[0] = (
        np.clip((np.median(log_cof[~data.driven]) - np.log(description.values.cof_off)) / NUISANCES[0].log_std, -5, 5)
        if (~data.driven).any()
        else 0.0
    )
    inflation, correlation = np.ones(data.count), 0.0
    for attempt in range(3):
        problem = Problem(predictor, log_cof, noise)
        discrepancy = features(data, noise)
        base = candidate(problem, discrepancy, (), problem.fit((), start))
        found = base.beside_discrepancy
        spread = np.concatenate([base.fit.jacobian, found.amplitude * discrepancy[found.term]], axis=1)
        target = base.fit.residual + base.fit.jacobian @ base.fit.vector
        inner = spread.T @ spread / found.scale**2 + np.eye(spread.shape[1])
        left = (target - spread @ np.linalg.solve(inner, spread.T @ target / found.scale**2)) / found.scale
        if attempt == 2:
            break
        outlying = np.abs(left) > OUTLIER
        if outlying.any() and outlying.sum() <= 0.15 * data.count and attempt == 0:
            inflation = np.where(outlying, np.abs(left), 1.0) * inflation
            warnings.append(
                f"{int(outlying.sum())} rows lie more than {OUTLIER:g} sigma off every smooth model; given less weight"
            )
        rho = _neighbour_correlation(data, left)
        if rho:
            correlation = rho
            warnings.append(f"noise of neighbouring rows is correlated ({rho:.2f}); taken into account")
        if not outlying.any() and not rho:
            break
        again = noise_of(data, correlation, inflation)
        if again is None:
            break
        noise = again
    return noise, problem, discrepancy, base


def _neighbour_correlation(data: Measurements, residual: Array) -> float:
    correlation, p = neighbour_correlation(data, residual)
    return float(np.clip(correlation, 0.0, 0.8)) if p < CORRELATED_P and correlation > 0.0 else 0.0


def _nuisance_warnings(chosen: Candidate) -> list[str]:
    return [
        f"{nuisance.name} moved {shift:+.1f} prior standard deviations: check the finger or the model file"
        for nuisance, shift in zip(NUISANCES[1:], chosen.fit.vector[1:], strict=False)
        if abs(shift) > 2.5
    ]
