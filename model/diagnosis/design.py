"""Which measurements tell the leading models apart soonest: blocks of settings, chosen one after the other.

What may hide a difference (`model.diagnosis.separation`): both models' parameters, as far as the data so far leave
them free, and the gains of the sessions to come. A block's cost is its time.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from model.diagnosis.data import Measurements
from model.diagnosis.fit import STEP
from model.diagnosis.naming import APART, Candidate, imitate, testable_effects, unseen_draws
from model.diagnosis.noise import shared_std
from model.diagnosis.separation import Choice, Pair, Told, by_block, choose, weights
from model.diagnosis.space import Predictor
from model.diagnosis.witness import WITNESSES
from model.diagnosis.workflow import Diagnosis, Findings
from model.effects.interventions import NOTHING
from model.support.arrays import Array

MODELS = 6  # that take part
FAINT = 4  # draws of an effect that is unseen so far, from the faintest to the plainest
USUAL_STD = 0.03  # of a witness that has said nothing so far, where nothing is usual of it


@dataclass(frozen=True)
class Pool:
    """What may be measured: `observations` [n] to come, each of one of B blocks; what each of those takes.

    `repeats`: how often every observation is made.
    """

    observations: Measurements
    block: NDArray[np.intp]
    cost_s: Array
    repeats: int


class Design(NamedTuple):
    """The blocks to measure, in the order of their use, and what even the whole pool could do for each pair.

    `reach` is the expected separation, chi^2, of the first model from each other one, were everything measured.
    """

    choices: tuple[Choice, ...]
    reach: dict[str, float]


def design(
    diagnosis: Diagnosis, pool: Pool, most: int, most_s: float, stubborn: Collection[frozenset[str]] = ()
) -> Design:
    """At most `most` blocks that together take at most `most_s`, those that tell most per second first.

    `stubborn` are pairs that settings were to tell apart before and did not: a rival bends further than its linear
    neighbourhood says. Of these an intervention is expected to tell, where the pool has one, and nothing else.
    """
    findings = diagnosis.findings
    if findings is None:
        return Design((), {})
    leaders = leading(findings)
    pairs = _pairs(findings, leaders, pool, _own_std(findings, diagnosis.data, pool.observations))
    acts = _of_interventions(pool)
    reach = {pair.names[1]: pair.reach() for pair in pairs if pair.names[0] == leaders[0][0].name}
    for pair in pairs:
        if frozenset(pair.names) in stubborn:
            asked = Pair(pair.names, pair.weight, pair.blocks.only(acts))
            pair.blocks = asked.blocks if asked.reach() >= APART else pair.blocks
    return Design(tuple(choose(pairs, pool.cost_s, most, most_s, APART)), reach)


def design_for_unseen(diagnosis: Diagnosis, pool: Pool, most: int, most_s: float) -> Design:
    """The blocks that would show most of what the data so far could not, where nothing shows.

    Of each effect of the catalogue some draws of its prior are taken that leave no trace so far and that the whole pool
    would show, the faintest of them included; finger and gains may hide them.
    """
    findings = diagnosis.findings
    if findings is None:
        return Design((), {})
    pairs = _unseen_pairs(findings, pool, _own_std(findings, diagnosis.data, pool.observations))
    return Design(tuple(choose(pairs, pool.cost_s, most, most_s, APART)), {p.names[1]: p.reach() for p in pairs})


def _unseen_pairs(findings: Findings, pool: Pool, own_std: Array) -> list[Pair]:
    """The base model with each effect that may be there unseen; the base model's parameters and gains may hide that."""
    problem, data, base = findings.problem, pool.observations, findings.weighed.base
    predictor = Predictor(problem.predictor.description, data, problem.predictor.free)
    here, spread = _mean_and_spread(predictor, base, base.fit.vector)
    std = own_std * np.sqrt(base.fit.scale2 / pool.repeats)
    sure = np.where(np.isfinite(here) & np.all(np.isfinite(spread), axis=1), 1.0 / std, 0.0)
    hides = sure[:, None] * np.nan_to_num(np.concatenate([_session_gains(data), spread], axis=1))
    normal = np.eye(hides.shape[1]) + hides.T @ hides
    pairs = []
    for kind in testable_effects(data, problem.predictor.description.effects):
        vectors = unseen_draws(problem, base, kind)
        if not vectors.size:
            continue
        difference = predictor.less(predictor.predicted((kind,), vectors), here)
        adds = np.where(np.isfinite(difference), sure * difference, 0.0)
        reach = Told(normal, adds @ hides, np.sum(adds**2, axis=1)).chi2()
        shown = np.argsort(reach)[np.count_nonzero(reach < APART) :]  # the faintest first
        kept = np.unique(np.linspace(0, shown.size - 1, FAINT).astype(int)) if shown.size else ()
        for i in kept:
            blocks = by_block(adds[shown[i]], hides, pool.block, pool.cost_s.size)
            pairs.append(Pair((base.name, kind.name), 1.0, blocks))
    return pairs


def _mean_and_spread(predictor: Predictor, candidate: Candidate, vector: Array) -> tuple[Array, Array]:
    """What a model predicts at a vector [n], and columns [n, k] of what the data leave free in its parameters."""
    values = predictor.predicted(candidate.kinds, np.vstack([vector, vector + STEP * np.eye(vector.size)]))
    root = np.linalg.cholesky(candidate.fit.covariance + 1e-12 * np.eye(vector.size))
    return values[0], (values[1:] - values[0]).T / STEP @ root


def _of_interventions(pool: Pool) -> NDArray[np.bool_]:
    """Which blocks are measured once somebody has done something."""
    done = pool.observations.intervention
    acts = np.zeros(pool.cost_s.size, dtype=bool)
    if done is not None:
        acts[pool.block[done != NOTHING]] = True
    return acts


def leading(findings: Findings) -> list[tuple[Candidate, float]]:
    """The models to tell apart with their probabilities: the chosen, what it is confused with, then the likeliest."""
    verdict, weighed = findings.verdict, findings.weighed
    alike = {name for names in verdict.group.values() for name in names}
    fitted = [c for c in (weighed.base, *weighed.singles) if c.kinds != verdict.chosen.kinds]
    fitted.sort(key=lambda c: (c.name not in alike, -verdict.probabilities[c.name]))
    own = [verdict.probabilities[kind.name] for kind in verdict.chosen.kinds]
    chosen = (verdict.chosen, sum(own) if own else verdict.probabilities[verdict.chosen.name])
    return [chosen, *((c, verdict.probabilities[c.name]) for c in fitted[: MODELS - 1])]


def _pairs(findings: Findings, leaders: Sequence[tuple[Candidate, float]], pool: Pool, own_std: Array) -> list[Pair]:
    """Every two models, weighed by the product of their probabilities.

    Beside the first, each other one is what it would be if the data so far were what the first says they are: what it
    can imitate there and in the pool, it is not to be told from by anything measured.
    """
    problem, data, first = findings.problem, pool.observations, leaders[0][0]
    predictor = Predictor(problem.predictor.description, data, problem.predictor.free)
    std = own_std * np.sqrt(findings.verdict.chosen.fit.scale2 / pool.repeats)
    means, spreads = [], []
    for candidate, _ in leaders:
        vector = (candidate.fit if candidate is first else imitate(problem, first.fit, candidate)).vector
        mean, spread = _mean_and_spread(predictor, candidate, vector)
        means.append(mean)
        spreads.append(spread)
    usable = np.all(np.isfinite(np.column_stack([*means, *spreads])), axis=1)
    sure = np.where(usable, 1.0 / std, 0.0)
    gains = _session_gains(data)
    pairs = []
    for (i, j), weight in weights([probability for _, probability in leaders]).items():
        difference = np.nan_to_num(predictor.less(means[i], means[j]))
        spread = np.nan_to_num(np.concatenate([gains, spreads[i], spreads[j]], axis=1))
        blocks = by_block(sure * difference, sure[:, None] * spread, pool.block, pool.cost_s.size)
        pairs.append(Pair((leaders[i][0].name, leaders[j][0].name), weight, blocks))
    return pairs


def _own_std(findings: Findings, before: Measurements, data: Measurements) -> Array:
    """Noise of observations to come: the median of that witness's so far, or what is usual of such an instrument."""
    noise = findings.problem.noise
    std = np.empty(data.count)
    for i in data.witnesses:
        seen = noise.own_std[before.of(i)]
        std[data.of(i)] = np.median(seen) if seen.size else WITNESSES[i].usual_std or USUAL_STD
    return std


def _session_gains(data: Measurements) -> Array:
    """Columns per witness and session to come, with what its gain and its touch's area may be."""
    group = np.unique(data.group, return_inverse=True)[1].ravel()
    here = group[:, None] == np.arange(group.max() + 1)
    return np.hstack([np.where(here, std[:, None], 0.0) for std in shared_std(data).T])
