"""Possible deviations of an effect's form: no finger or device has quite the catalogue's.

An effect's signature is what it adds to the prediction. Its form may differ in two ways, in
proportion to what the effect does. That separates both from a discrepancy of unknown shape:

Each witness apart: a smooth share of the signature of unknown shape, a Gaussian process over each
input that varies, times the signature's size. Where the signature grows faster than the effect's
strength, the size is what that share of the strength would change, up to twice as much.

All witnesses together: the effect's strength depends smoothly on what it `bends_with`, in amount
and in phase; what that changes follows from the model. The strength may depend on frequency, as for
an element whose circuit the catalogue does not know. An amplifier's gain may depend on the
amplitude as well, since spectra are taken at a few volts. For other dependences the catalogue has
effects.
"""

from __future__ import annotations

import numpy as np

from model.diagnosis.data import Measurements
from model.diagnosis.model_fit import Fit, Problem
from model.diagnosis.smooth import compressed
from model.diagnosis.witness import CURRENT, CURRENT_PHASE, VOLTAGE, VOLTAGE_PHASE
from model.effects import Effect
from model.effects.base import EffectParameter
from model.support.arrays import Array

STEP = 1e-3  # of an effect's strength
# times the signature, as of a square: what sets in suddenly could else look like much
MOST_BY_STRENGTH = 2.0
COMPLEX = (
    (CURRENT, CURRENT_PHASE),
    (VOLTAGE, VOLTAGE_PHASE),
)  # of one number: what is off in either shows in both


def form_terms(problem: Problem, fit: Fit) -> list[Array]:
    """Possible deviations of the forms of a fitted model's effects, whitened [n, k], per unit of
    their signatures or strength.

    First each witness apart, then all together; none where no effect does anything.
    """
    whole = problem.predictor.predicted(fit.kinds, fit.vector[None])[0]
    apart, together = [], []
    for i, kind in enumerate(fit.kinds):
        size, change = _size_and_change(problem, fit, i, whole)
        apart.append(size[:, None] * problem.smooth)
        smooth = [problem.smooth_in_drive[name] for name in kind.bends_with()]
        changes = (change, _turned(problem.predictor.data, change))
        bends = [each[:, None] * of_drive for of_drive in smooth for each in changes]
        together.append(np.hstack(bends) if bends else apart[-1])
    ways = [apart, together] if any(kind.bends_with() for kind in fit.kinds) else [apart]
    terms = [compressed(problem.noise.whiten(np.hstack(parts))) for parts in ways if parts]
    return [term for term in terms if term.shape[1]]


def _size_and_change(problem: Problem, fit: Fit, i: int, whole: Array) -> tuple[Array, Array]:
    """Size of the i-th effect's signature, or of what its strength changes where that is more, up
    to twice as much [n].

    And what its strength changes [n], up to twice the signature; `whole` [n]: what all effects
    predict.
    """
    data, predictor = problem.predictor.data, problem.predictor
    signature = _size(data, predictor.less(whole, _without(problem, fit, i)))
    change = np.nan_to_num(predictor.less(_stronger(problem, fit, i), whole) / STEP)
    by_strength = _size(data, change)
    change = change * np.minimum(
        1.0, MOST_BY_STRENGTH * signature / np.maximum(by_strength, 1e-300)
    )
    return np.clip(by_strength, signature, MOST_BY_STRENGTH * signature), change


def _turned(data: Measurements, change: Array) -> Array:
    """Changes of complex numbers, as logarithm and angle, a quarter turn on [n]; 0 for others, and
    of half a number.
    """
    turned = np.zeros(change.size)
    if data.witness is None or data.row is None:
        return turned
    for amount, angle in COMPLEX:
        for of, to, sign in ((amount, angle, 1.0), (angle, amount, -1.0)):
            by_row = np.zeros(data.row.max() + 1)
            by_row[data.row[data.witness == of]] = change[data.witness == of]
            turned[data.witness == to] = sign * by_row[data.row[data.witness == to]]
    return turned


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
    """How far a parameter is from where its effect is off; in logarithms 1 where that is at no
    value.
    """
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
