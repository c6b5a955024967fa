"""Proof on data that no fit has seen: the effect is chosen anew in every fold and judged on what
was left out.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from model.description import ModelDescription
from model.diagnosis.data import Measurements
from model.diagnosis.evidence import evidence
from model.diagnosis.hypotheses import Candidate
from model.diagnosis.model_fit import Fit, Problem
from model.diagnosis.noise import Noise, noise_of
from model.diagnosis.priors import LOG_PRIOR_EACH
from model.diagnosis.space import Predictor, nuisances
from model.effects import Effect
from model.support.arrays import Array

FEWEST_SESSIONS = 3
BLOCKS = 5
BOOTSTRAPS = 2000
Kinds = tuple[type[Effect], ...]


@dataclass(frozen=True)
class Proof:
    """What held-out data say: mean squared error in units of the noise, per point, before and
    after.

    `gap_closed`: share of the base model's excess over the noise that disappears, with a 95 %
    interval over folds; `inclusion`: share of folds in which the same effects were chosen again.
    NaN where nothing could be held out.
    """

    by: str
    folds: tuple[str, ...]
    before: Array
    after: Array
    gap_closed: float
    interval: tuple[float, float]
    inclusion: float


class Selected(NamedTuple):
    """What was chosen without a fold, and whether that is what all data chose."""

    fit: Fit
    as_chosen: bool


def prove(
    description: ModelDescription,
    data: Measurements,
    noise: Noise,
    chosen: Candidate,
    rivals: list[Candidate],
    scale: float,
    seed: int,
    progress: Callable[[str], None],
) -> Proof:
    """Leave out sessions where there are three or more, else blocks of settings; errors in units of
    `scale` x noise.

    The chosen model and `rivals` are chosen among anew in each fold. A fold that leaves no noise to
    fit by, or hardly a row to judge, is left out.
    """
    contenders = [chosen, *[r for r in rivals if r.kinds != chosen.kinds]]

    def select(problem: Problem, _: Fit) -> list[Selected]:
        fits = [problem.fit(c.kinds, c.fit.vector) for c in contenders]
        scores = [
            evidence(f, problem.noise).log_evidence + LOG_PRIOR_EACH * len(f.kinds) for f in fits
        ]
        best = fits[int(np.argmax(scores))]
        return [Selected(best, best.kinds == chosen.kinds)]

    return held_out(description, data, noise, select, chosen.fit.vector, scale, seed, progress)[0]


def held_out(
    description: ModelDescription,
    data: Measurements,
    noise: Noise,
    select: Callable[[Problem, Fit], list[Selected]],
    start: Array,
    scale: float,
    seed: int,
    progress: Callable[[str], None],
) -> list[Proof]:
    """Proofs of the models that `select` makes, without the fold in question, of a problem and its
    base model's fit.

    As many and in the same order in every fold; base models are fitted from `start`.
    """
    by, fold = _folds(data, seed)
    free = nuisances(description, data)
    names = [
        data.session_names[i] if by == "session" else f"block {i + 1}"
        for i in range(fold.max() + 1)
    ]
    judged, before, after, kept, weights = [], [], [], [], []
    for i in range(fold.max() + 1):
        progress(f"held out: {names[i]}")
        inside, outside = data.subset(fold != i), data.subset(fold == i)
        inner_noise = noise_of(inside)
        if inner_noise is None or outside.count < 2:
            continue
        problem = Problem(Predictor(description, inside, free), inside.observed, inner_noise)
        base = problem.fit((), start[: len(free)])
        selected = select(problem, base)
        outer = Predictor(description, outside, free)
        own_std = noise.own_std[fold == i] * scale
        judged.append(names[i])
        before.append(_error(outer, outside, (), base.vector, own_std))
        after.append([_error(outer, outside, s.fit.kinds, s.fit.vector, own_std) for s in selected])
        kept.append([s.as_chosen for s in selected])
        weights.append(outside.count)
    if not before:
        nothing = np.empty(0)
        return [
            Proof(
                by, (), nothing, nothing, float("nan"), (float("nan"), float("nan")), float("nan")
            )
        ]
    w = np.array(weights, dtype=float)
    draws = np.random.default_rng(seed).integers(0, w.size, (BOOTSTRAPS, w.size))
    return [
        _proof(by, tuple(judged), np.array(before), np.array(each), w, draws, float(np.mean(same)))
        for each, same in zip(zip(*after, strict=True), zip(*kept, strict=True), strict=True)
    ]


def _proof(
    by: str,
    folds: tuple[str, ...],
    a: Array,
    b: Array,
    w: Array,
    draws: NDArray[np.int64],
    inclusion: float,
) -> Proof:
    closed = [_closed(a[d], b[d], w[d]) for d in draws]
    finite = np.array([c for c in closed if np.isfinite(c)])
    low, high = np.percentile(finite, [2.5, 97.5]) if finite.size else (np.nan, np.nan)
    return Proof(by, folds, a, b, _closed(a, b, w), (float(low), float(high)), inclusion)


def _folds(data: Measurements, seed: int) -> tuple[str, NDArray[np.intp]]:
    if len(np.unique(data.session)) >= FEWEST_SESSIONS:
        return "session", np.unique(data.session, return_inverse=True)[1].ravel()
    group = data.replicate_groups(apart=False)
    shuffled = np.random.default_rng(seed).permutation(group.max() + 1) % BLOCKS
    return "block", shuffled[group]


def _error(
    outer: Predictor, data: Measurements, kinds: Kinds, vector: Array, own_std: Array
) -> float:
    """Mean squared held-out residual in units of the noise, the held-out sessions' own gains
    removed.
    """
    residual = outer.less(data.observed, outer.predicted(kinds, vector[None])[0])
    weight = 1.0 / own_std**2
    groups = np.unique(data.group)
    for g in groups:
        rows = data.group == g
        residual[rows] -= np.sum(residual[rows] * weight[rows]) / np.sum(weight[rows])
    return float(np.sum(residual**2 * weight) / max(data.count - groups.size, 1))


def _closed(before: Array, after: Array, weight: Array) -> float:
    base, new = np.average(before, weights=weight), np.average(after, weights=weight)
    return float(1.0 - (new - 1.0) / (base - 1.0)) if base > 1.0 else float("nan")
