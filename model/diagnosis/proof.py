"""Proof on data that no fit has seen: the effect is chosen anew in every fold and judged on what
was left out.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cholesky, solve_triangular

from model.description import ModelDescription
from model.diagnosis.data import Measurements
from model.diagnosis.evidence import evidence
from model.diagnosis.forms import Share
from model.diagnosis.hypotheses import Candidate, Kinds
from model.diagnosis.model_fit import BAD, Fit, Problem
from model.diagnosis.noise import Noise, noise_of
from model.diagnosis.priors import LOG_PRIOR_EACH
from model.diagnosis.sessions import FEWEST_SESSIONS
from model.diagnosis.space import Predictor, nuisances
from model.effects import Effect
from model.support.arrays import Array

BLOCKS = 5
BOOTSTRAPS = 2000


@dataclass(frozen=True)
class Proof:
    """What held-out data say: mean squared error in units of the noise, per point, before and
    after, and the number of `rows` of each fold.

    `gap_closed`: share of the base model's excess over the noise that disappears, with a 95 %
    interval over folds. `inclusion`: share of folds in which the same effects were chosen again.
    NaN where nothing could be held out. `shares`: of each leading model, what each of its effects
    closes of the gap that is there without it. Empty where nothing could be held out.
    """

    by: str
    folds: tuple[str, ...]
    rows: Array
    before: Array
    after: Array
    gap_closed: float
    interval: tuple[float, float]
    inclusion: float
    shares: dict[tuple[str, ...], list[Share]] = field(default_factory=dict)


class Selected(NamedTuple):
    """What was chosen without a fold, and whether that is what all data chose."""

    fit: Fit
    as_chosen: bool


def prove(
    description: ModelDescription,
    data: Measurements,
    noise: Noise,
    chosen: Candidate,
    others: list[Candidate],
    scale: float,
    seed: int,
    progress: Callable[[str], None],
) -> Proof:
    """Leave out sessions where there are three or more, else blocks of settings; errors in units of
    `scale` x noise.

    Each fold chooses anew among the chosen model and `others`, which hold every effect of a pair
    alone. A fold that leaves no noise to fit by, or hardly a row to judge, is left out.
    """
    models = {c.kinds: c for c in (chosen, *others)}

    def select(problem: Problem, _base: Fit) -> list[Selected]:
        fits = [problem.fit(c.kinds, c.fit.vector) for c in models.values()]
        best = max(fits, key=lambda fit: _score(problem, fit))
        return [Selected(fit, fit.kinds == chosen.kinds) for fit in (best, *fits)]

    proof, *each = held_out(
        description, data, noise, select, chosen.fit.vector, scale, seed, progress
    )
    if not proof.folds:
        return proof
    errors = {kinds: of.after for kinds, of in zip(models, each, strict=True)} | {(): proof.before}
    draws = _draws(proof.rows.size, seed)

    def share(kinds: Kinds, kind: type[Effect]) -> Share:
        without, error = errors[_without(kinds, kind)], errors[kinds]
        drawn = _closed(without[draws], error[draws], proof.rows[draws])
        std = float(np.nanstd(drawn)) if np.isfinite(drawn).any() else float("nan")
        return Share(kind.name, float(_closed(without, error, proof.rows)), std)

    shares = {c.names: [share(kinds, kind) for kind in kinds] for kinds, c in models.items()}
    return replace(proof, shares={names: of for names, of in shares.items() if of})


def _score(problem: Problem, fit: Fit) -> float:
    """log of prior times evidence."""
    return evidence(fit, problem.noise).log_evidence + LOG_PRIOR_EACH * len(fit.kinds)


def _without(kinds: Kinds, left_out: type[Effect]) -> Kinds:
    return tuple(kind for kind in kinds if kind is not left_out)


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
    by, fold, names = _folds(data, seed)
    free = nuisances(description, data)
    judged, before, after, kept, weights = [], [], [], [], []
    for i in range(fold.max() + 1):
        progress(f"held out: {names[i]}")
        inside, outside = data.subset(fold != i), data.subset(fold == i)
        inner_noise = noise_of(inside, noise.correlation, noise.inflation[fold != i])
        if inner_noise is None or outside.count < 2:
            continue
        problem = Problem(Predictor(description, inside, free), inside.observed, inner_noise)
        base = problem.fit((), start[: len(free)])
        selected = select(problem, base)
        outer = Predictor(description, outside, free)
        lower = noise.lower[fold == i] * scale
        judged.append(names[i])
        before.append(_error(outer, outside, (), base.vector, lower))
        after.append([_error(outer, outside, s.fit.kinds, s.fit.vector, lower) for s in selected])
        kept.append([s.as_chosen for s in selected])
        weights.append(outside.count)
    if not before:
        nothing = np.empty(0)
        return [
            Proof(
                by,
                (),
                nothing,
                nothing,
                nothing,
                float("nan"),
                (float("nan"), float("nan")),
                float("nan"),
            )
        ]
    w = np.array(weights, dtype=float)
    draws = _draws(w.size, seed)
    return [
        _proof(by, tuple(judged), np.array(before), np.array(each), w, draws, float(np.mean(same)))
        for each, same in zip(zip(*after, strict=True), zip(*kept, strict=True), strict=True)
    ]


def _draws(folds: int, seed: int) -> NDArray[np.int64]:
    """Bootstrap samples [BOOTSTRAPS, folds] of the folds."""
    return np.random.default_rng(seed).integers(0, folds, (BOOTSTRAPS, folds))


def _proof(
    by: str,
    folds: tuple[str, ...],
    a: Array,
    b: Array,
    w: Array,
    draws: NDArray[np.int64],
    inclusion: float,
) -> Proof:
    closed = _closed(a[draws], b[draws], w[draws])
    finite = closed[np.isfinite(closed)]
    low, high = np.percentile(finite, [2.5, 97.5]) if finite.size else (np.nan, np.nan)
    return Proof(by, folds, w, a, b, float(_closed(a, b, w)), (float(low), float(high)), inclusion)


class _Folds(NamedTuple):
    """What is left out at a time: of what kind, the number of each row's fold [n], and names."""

    by: str
    fold: NDArray[np.intp]
    names: tuple[str, ...]


def _folds(data: Measurements, seed: int) -> _Folds:
    if len(np.unique(data.session)) >= FEWEST_SESSIONS:
        numbers, fold = np.unique(data.session, return_inverse=True)
        return _Folds("session", fold.ravel(), tuple(data.session_names[s] for s in numbers))
    group = data.replicate_groups(apart=False)
    shuffled = np.random.default_rng(seed).permutation(group.max() + 1) % BLOCKS
    fold = shuffled[group]
    return _Folds("block", fold, tuple(f"block {i + 1}" for i in range(fold.max() + 1)))


def _error(
    outer: Predictor, data: Measurements, kinds: Kinds, vector: Array, lower: Array
) -> float:
    """Mean squared held-out residual in units of the noise, the held-out sessions' own gains
    removed.

    `lower` [n, m]: rows of a root of the noise's covariance. Rows of which the model says nothing
    are far off.
    """
    residual = outer.less(data.observed, outer.predicted(kinds, vector[None])[0])
    far_off = BAD * np.sqrt(np.sum(lower**2, axis=1))
    residual = np.where(np.isfinite(residual), residual, far_off)
    groups, total = np.unique(data.group), 0.0
    for g in groups:
        rows = data.group == g
        root = cholesky(lower[rows] @ lower[rows].T, lower=True)
        both = np.stack([residual[rows], np.ones(rows.sum())], axis=1)
        white, gain = solve_triangular(root, both, lower=True).T
        total += float(white @ white - (white @ gain) ** 2 / (gain @ gain))
    return total / max(data.count - groups.size, 1)


def _closed(before: Array, after: Array, weight: Array) -> Array:
    """Share of the gap over the last axis; NaN where there is none."""
    base, new = (np.average(errors, axis=-1, weights=weight) for errors in (before, after))
    return np.asarray(1.0 - (new - 1.0) / np.where(base > 1.0, base - 1.0, np.nan))
