"""Which friction is changed by what the model lacks, over all hypotheses."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import product

import numpy as np

from model.diagnosis.data import Measurements
from model.diagnosis.evidence import taken_up
from model.diagnosis.hypotheses import Candidate, Hypotheses
from model.diagnosis.model_fit import Problem
from model.diagnosis.posterior import Posterior
from model.diagnosis.priors import NONE, UNKNOWN
from model.diagnosis.smooth import INPUTS
from model.diagnosis.witness import FRICTION
from model.support.arrays import Array, Mask

Range = tuple[float, float]


def changed(
    problem: Problem, hypotheses: Hypotheses, posterior: Posterior, learned: Candidate | None = None
) -> Array:
    """Probability that an observation is friction that is changed by more than its noise [n].

    What is unknown is the `learned` term where there is one, else a smooth discrepancy. Hypotheses
    that no column could show change nothing.
    """
    silent, found = {NONE, *posterior.untestable}, np.zeros(problem.observed.size)
    for names, probability in posterior.hypotheses.items():
        if silent & set(names):
            continue
        if names != (UNKNOWN,):
            change = change_by_effects(problem, hypotheses.of(names))
        elif learned is not None:
            change = change_by_effects(problem, learned)
        else:
            change = _smooth_change(problem, hypotheses.base)
        found += probability * (np.abs(change) > problem.noise.own_std)
    return np.where(problem.predictor.data.of(FRICTION), found, 0.0)


def change_by_effects(problem: Problem, chosen: Candidate) -> Array:
    """What a model's effects add to its predictions for the finger that it fits, as observed
    [n].
    """
    predictor, vectors = problem.predictor, chosen.around.vector[None]
    without = predictor.predicted((), vectors[:, : len(predictor.free)])[0]
    change = predictor.less(predictor.predicted(chosen.kinds, vectors)[0], without)
    return np.asarray(np.nan_to_num(change))  # nothing where the model says nothing


def _smooth_change(problem: Problem, base: Candidate) -> Array:
    """The most probable discrepancy beside a model, as observed [n]."""
    beside = base.beside_discrepancy
    loose = beside.amplitude * problem.discrepancy[beside.term]
    return np.asarray(problem.noise.lower @ taken_up(base.fit, beside.scale, loose))


def places(data: Measurements, probability: Array) -> list[dict[str, Range]]:
    """Where friction is more likely changed than not: ranges of inputs, ends included, that hold
    those rows and no others, the largest first.

    A range of frequencies is of rows with voltage. Where inputs do not tell rows apart, others come
    in.
    """
    friction = data.of(FRICTION)
    return _boxes(data.subset(friction), probability[friction] > 0.5)


def _boxes(data: Measurements, rows: Mask) -> list[dict[str, Range]]:
    inputs = {name: data.columns[name] for name in INPUTS if data.varies(name)}
    found, left = list[tuple[int, dict[str, Range]]](), rows.copy()
    while left.any():
        box = _grown(inputs, data.driven, int(np.argmax(left)), rows)
        held = _held(box, inputs, data.driven)
        found.append((int(np.sum(held & left)), box))
        left &= ~held
    return [box for _, box in sorted(found, key=lambda item: -item[0])]


def _grown(inputs: Mapping[str, Array], driven: Mask, row: int, rows: Mask) -> dict[str, Range]:
    """The box of one row, enlarged by a level of each input in turn as long as no other than
    `rows` comes in.
    """
    levels = {name: np.unique(values) for name, values in inputs.items()}
    box = {name: (float(values[row]), float(values[row])) for name, values in inputs.items()}
    if not driven[row]:
        box.pop("frequency_hz", None)

    def others(box: Mapping[str, Range]) -> int:
        return int(np.sum(_held(box, inputs, driven) & ~rows))

    least, before = others(box), None
    while box != before:
        before = box
        for name, larger in product(before, (_lower, _higher)):
            tried = box | {name: larger(box[name], levels[name])}
            box = tried if others(tried) <= least else box
    for name in before:
        fewer = {other: limits for other, limits in box.items() if other != name}
        if fewer and others(fewer) <= least:
            box = fewer
    return box


def _lower(limits: Range, levels: Array) -> Range:
    """From one level lower, where there is one."""
    return float(levels[levels < limits[0]].max(initial=levels[0])), limits[1]


def _higher(limits: Range, levels: Array) -> Range:
    """To one level higher, where there is one."""
    return limits[0], float(levels[levels > limits[1]].min(initial=levels[-1]))


def _held(box: Mapping[str, Range], inputs: Mapping[str, Array], driven: Mask) -> Mask:
    """The rows inside of a box [n]."""
    held = driven.copy() if "frequency_hz" in box else np.ones_like(driven)
    for name, (low, high) in box.items():
        held &= (inputs[name] >= low) & (inputs[name] <= high)
    return held
