"""What a plan could separate, before anything is measured: every effect compared with every other
one.

An effect of the wanted strength predicts what each row would say, without noise; each other effect,
and none, is then fitted to that. What it cannot imitate, in chi^2, is lambda_ij: `design` says
which measurements raise it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from model.description import ModelDescription
from model.diagnosis.data import Measurements
from model.diagnosis.hypotheses import STARTS, testable_effects
from model.diagnosis.model_fit import Fit, Problem
from model.diagnosis.noise import Noise, noise_of
from model.diagnosis.priors import NONE
from model.diagnosis.space import Predictor
from model.effects import Effect
from model.planning.separation import APART
from model.support.arrays import Array
from model.support.errors import ModelError

# an alternative that one step of its fit leaves farther than this does not come near
FAR = 10.0 * APART


@dataclass(frozen=True)
class Resolution:
    """`separation` [n, n + 1], chi^2: true effect by row; the last column is the model without any
    effect.

    An alternative that does not come near is left where a few steps of its fit ended. The true
    value is no higher, and was not worth more. The diagonal is infinite.
    """

    names: tuple[str, ...]
    separation: Array

    def visible(self, i: int) -> float:
        """How far the i-th effect is from none."""
        return float(self.separation[i, -1])

    def alike(self, i: int) -> list[str]:
        """What could stand for the i-th effect, the likest first; `none` where it would leave no
        trace.
        """
        order = np.argsort(self.separation[i], kind="stable")
        return [(*self.names, NONE)[j] for j in order if self.separation[i, j] < APART]


def resolution(
    description: ModelDescription,
    data: Measurements,
    strength: float = 0.0,
    progress: Callable[[str], None] = lambda _: None,
) -> Resolution:
    """Separation of every two effects in `data`, whose observed values do not matter and whose
    noise must be stated.

    `strength`: of the true effect, in standard deviations of its prior beyond the usual one. What
    leaves no trace is compared with nothing else. ModelError where no effect could be seen in such
    data.
    """
    kinds = testable_effects(data, description.effects)
    noise = noise_of(data)
    if noise is None or not kinds:
        raise ModelError(
            "no effect could be seen in these settings", "Vary frequency, voltage, load or speed"
        )
    predictor = Predictor(description, data)
    found = np.full((len(kinds), len(kinds) + 1), np.inf)
    for i, kind in enumerate(kinds):
        progress(kind.name)
        vector = np.zeros(predictor.size((kind,)))
        vector[len(predictor.free)] = _usual(kind, strength)
        prediction = predictor.predicted((kind,), vector[None])[0]
        usable = np.isfinite(prediction)
        problem = _seen(description, data.subset(usable), prediction[usable], noise)
        base = problem.fit((), np.zeros(len(predictor.free)))
        found[i, -1] = base.chi2
        for j, alternative in enumerate(kinds):
            if alternative is not kind and base.chi2 >= APART:
                found[i, j] = _left(problem, base, alternative)
    return Resolution(tuple(kind.name for kind in kinds), found)


def _usual(kind: type[Effect], stronger: float) -> float:
    """The first parameter in prior units: its median, or a standard deviation off where that is no
    effect at all.
    """
    first = kind.parameters()[0]
    if first.off == np.inf:
        return -stronger
    return stronger + (1.0 if first.from_normal(0.0) == first.off else 0.0)


def _seen(
    description: ModelDescription, data: Measurements, prediction: Array, noise: Noise
) -> Problem:
    """What would be seen: without the rows that the true effect leaves without an equilibrium."""
    if data.count < noise.own_std.size:
        fewer = noise_of(data)
        assert fewer is not None
        noise = fewer
    return Problem(Predictor(description, data), prediction, noise)


def _left(problem: Problem, base: Fit, alternative: type[Effect]) -> float:
    """What is left of the true effect beside the alternative, in chi^2."""
    starts = np.zeros((len(STARTS), problem.predictor.size((alternative,))))
    starts[:, : base.vector.size], starts[:, base.vector.size] = base.vector, STARTS
    near = base.chi2
    for residual, jacobian in zip(*problem.linearised((alternative,), starts), strict=True):
        within, _ = np.linalg.qr(jacobian)
        near = min(near, float(residual @ residual - np.sum((within.T @ residual) ** 2)))
    if near > FAR:
        return near
    return min(base.chi2, problem.best_fit((alternative,), base.vector, STARTS).chi2)
