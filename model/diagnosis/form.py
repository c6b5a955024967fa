"""What a form may be off: no finger or device has quite the catalogue's.

An effect's signature is what it adds to the prediction. Beside it stands a smooth share of that signature of unknown
shape, for every witness its own: a Gaussian process over each input that varies, times the signature's size. Where the
signature grows faster than the effect's strength, the size is what that share of the strength would change, up to twice
as much. It cannot add anything where the effect does nothing, which tells it from a discrepancy of unknown shape.
"""

from __future__ import annotations

import numpy as np

from model.diagnosis.data import Measurements
from model.diagnosis.fit import Fit, Problem
from model.diagnosis.smooth import compressed
from model.diagnosis.witness import CURRENT, CURRENT_PHASE, VOLTAGE, VOLTAGE_PHASE
from model.effects import Effect
from model.effects.base import EffectParameter
from model.support.arrays import Array

STEP = 1e-3  # of an effect's strength
MOST_BY_STRENGTH = 2.0  # times the signature, as of a square: what sets in suddenly could else look like much
COMPLEX = ((CURRENT, CURRENT_PHASE), (VOLTAGE, VOLTAGE_PHASE))  # of one number: what is off in either shows in both


def form_terms(problem: Problem, fit: Fit) -> Array:
    """What the forms of a fitted model's effects may be off, whitened [n, k], per unit of their signatures."""
    parts = [problem.noise.whiten(size[:, None] * problem.smooth) for size in _sizes(problem, fit)]
    return compressed(np.concatenate(parts, axis=1)) if parts else np.zeros((fit.residual.size, 0))


def _sizes(problem: Problem, fit: Fit) -> list[Array]:
    """Size [n] of each effect's signature, or of what its strength changes where that is more, up to twice as much."""
    data, predictor = problem.predictor.data, problem.predictor
    whole = predictor.predicted(fit.kinds, fit.vector[None])[0]
    sizes = []
    for i in range(len(fit.kinds)):
        signature = _size(data, predictor.less(whole, _without(problem, fit, i)))
        by_strength = _size(data, predictor.less(_stronger(problem, fit, i), whole) / STEP)
        sizes.append(np.clip(by_strength, signature, MOST_BY_STRENGTH * signature))
    return sizes


def _first(problem: Problem, fit: Fit, i: int) -> int:
    """Where the parameters of the i-th effect begin in the fit's vector."""
    return len(problem.predictor.free) + sum(len(kind.parameters()) for kind in fit.kinds[:i])


def _stronger(problem: Problem, fit: Fit, i: int) -> Array:
    """What would be predicted with the i-th effect stronger (or weaker) by the share STEP [n]."""
    first, strength = _first(problem, fit, i), fit.kinds[i].parameters()[0]
    vector = fit.vector.copy()
    step = STEP * _strength(strength, vector[first]) / strength.std
    vector[first] -= np.copysign(step, vector[first])  # inwards: beyond its end it is flat
    return np.asarray(problem.predictor.predicted(fit.kinds, vector[None])[0])


def _strength(parameter: EffectParameter, x: float) -> float:
    """How far a parameter is from where its effect is off; in logarithms 1 where that is at no value."""
    value = float(parameter.from_normal(x))
    if parameter.scale == "linear":
        return value - parameter.off
    return float(np.log(value / parameter.off)) if 0.0 < parameter.off < np.inf else 1.0


def _without(problem: Problem, fit: Fit, i: int) -> Array:
    """What would be predicted without the i-th effect [n]."""
    first = _first(problem, fit, i)
    kinds: tuple[type[Effect], ...] = (*fit.kinds[:i], *fit.kinds[i + 1 :])
    vector = np.delete(fit.vector, slice(first, first + len(fit.kinds[i].parameters())))
    return np.asarray(problem.predictor.predicted(kinds, vector[None])[0])


def _size(data: Measurements, signature: Array) -> Array:
    """How large it is; of a complex number where amount and phase are both seen."""
    signature = np.nan_to_num(signature)
    size = np.abs(signature)
    if data.witness is None or data.row is None:
        return size
    for both in COMPLEX:
        mine = np.isin(data.witness, both)
        squares = np.bincount(data.row[mine], signature[mine] ** 2)
        size[mine] = np.sqrt(squares[data.row[mine]])
    return size
