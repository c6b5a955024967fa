"""Which measurements tell the leading models apart soonest: blocks of settings, chosen one after
the other.

What may hide a difference (`model.planning.discrimination`): both models' parameters, within what
the present data leave free, and the gains of the sessions to come. A block's cost is its time.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from model.diagnosis.data import Measurements
from model.diagnosis.hidden import unseen_draws
from model.diagnosis.hypotheses import Candidate, testable_effects
from model.diagnosis.model_fit import STEP
from model.diagnosis.noise import shared_std
from model.diagnosis.space import FARTHEST, Predictor
from model.diagnosis.witness import WITNESSES
from model.diagnosis.workflow import Diagnosis, Findings
from model.effects.base import Effect
from model.effects.interventions import NOTHING
from model.planning.discrimination import (
    Choice,
    Information,
    Pair,
    by_all,
    by_block,
    choose,
    information_of,
    most_by_one,
    nothing,
    weights,
    with_each,
)
from model.planning.separation import APART, imitate
from model.support.arrays import Array

MODELS = 6  # that take part
FAINT = 4  # draws of an effect that is unseen so far, from the faintest to the plainest
SHOWS = 16.0  # chi^2 from which an effect shows
USUAL_STD = 0.03  # of a witness that has said nothing so far, where nothing is usual of it


@dataclass(frozen=True)
class Pool:
    """What may be measured: `observations` [n] to come, each of one of B blocks; what each of those
    takes.

    `repeats`: how often every observation is made.
    """

    observations: Measurements
    block: NDArray[np.intp]
    cost_s: Array
    repeats: int


class Design(NamedTuple):
    """The blocks to measure, in the order of their use, and what even the whole pool could do for
    each pair.

    `reach` is the expected separation, chi^2, of the first model from each other one, were
    everything measured.
    """

    choices: tuple[Choice, ...]
    reach: dict[str, float]


def design(
    diagnosis: Diagnosis,
    pool: Pool,
    most: int,
    most_s: float,
    stubborn: Collection[frozenset[str]] = (),
    enough: float = APART,
) -> Design:
    """At most `most` blocks that together take at most `most_s`, those that tell most per second
    first.

    Each pair's separation counts up to `enough`, in chi^2.

    `stubborn` are pairs that earlier settings failed to separate: an alternative deviates further
    than its linear neighbourhood says. Only an intervention, where the pool has one, is expected to
    separate these.
    """
    findings = diagnosis.findings
    if findings is None:
        return Design((), {})
    leaders = leading(findings)
    pairs = _pairs(findings, leaders, pool, _own_std(findings, diagnosis.data, pool))
    acts = _of_interventions(pool)
    reach = {pair.names[1]: pair.reach() for pair in pairs if pair.names[0] == leaders[0][0].name}
    for pair in pairs:
        if frozenset(pair.names) in stubborn:
            asked = replace(pair, blocks=pair.blocks.only(acts))
            pair.blocks = asked.blocks if asked.reach() >= APART else pair.blocks
    return Design(tuple(choose(pairs, pool.cost_s, most, most_s, enough)), reach)


def design_for_unseen(
    diagnosis: Diagnosis, pool: Pool, most: int, most_s: float, only: Collection[str] | None = None
) -> Design:
    """The blocks that would show most of what the data so far could not, where nothing shows.

    For each effect of the catalogue, or of `only` these, some draws of its prior are taken. They
    leave no trace so far, and some block would show them, or where more blocks are left, the whole
    pool. The faintest of them is included. Finger and gains may hide them.
    """
    findings = diagnosis.findings
    if findings is None:
        return Design((), {})
    testable = testable_effects(pool.observations, findings.problem.predictor.description.effects)
    kinds = [kind for kind in testable if only is None or kind.name in only]
    problem, base = findings.problem, findings.hypotheses.base
    draws = {kind: unseen_draws(problem, base.fit, kind) for kind in kinds}
    unseen = _unseen(findings, draws, pool, _own_std(findings, diagnosis.data, pool))
    choices, reach = list[Choice](), dict[str, float]()
    for reach_of in (most_by_one, by_all):
        pairs = [pair for each in unseen for pair in each.shown(reach_of)]
        reach |= {pair.names[1]: pair.reach() for pair in pairs}
        choices = choose(pairs, pool.cost_s, most, most_s, SHOWS, first=choices)
    return Design(tuple(choices), reach)


class Shown(NamedTuple):
    """The block that shows an effect of usual size best, and the lambda that it has with that."""

    block: int
    after: float


def shown_by_one(
    diagnosis: Diagnosis, findings: Findings, pool: Pool, kinds: Sequence[type[Effect]]
) -> dict[str, Shown]:
    """For each of these effects that the pool can show, the one block that does it best."""
    hidden = findings.hypotheses.hidden
    draws = {
        kind: (hidden[kind.name].vector[None], hidden[kind.name].signature[None])
        for kind in testable_effects(
            pool.observations, findings.problem.predictor.description.effects
        )
        if kind in kinds
    }
    found = {}
    for each in _unseen(findings, draws, pool, _own_std(findings, diagnosis.data, pool)):
        reached = with_each(each.so_far, each.blocks)[:, 0]
        best = int(np.argmax(reached))
        found[each.names[1]] = Shown(best, float(reached[best]))
    return found


class _Unseen(NamedTuple):
    """The base model with an effect that may be there unseen: draws of its prior [m], with their
    visibility so far and in each block.
    """

    names: tuple[str, str]
    so_far: Information
    blocks: Information

    def shown(self, reach_of: Callable[[Information, Information], Array]) -> list[Pair]:
        """Some of the draws that can be made to show, from the faintest on; they weigh as many as
        they stand for.
        """
        reach = reach_of(self.so_far, self.blocks)
        shown = np.argsort(reach)[np.count_nonzero(reach < SHOWS) :]
        return [
            Pair(
                self.names,
                float(shown.size),
                Information(self.blocks.normal, self.blocks.moment[:, i], self.blocks.square[:, i]),
                Information(self.so_far.normal, self.so_far.moment[i], self.so_far.square[i]),
            )
            for i in shown[
                np.unique(np.linspace(0, shown.size - 1, min(FAINT, shown.size)).astype(int))
            ]
        ]


def _unseen(
    findings: Findings,
    draws: Mapping[type[Effect], tuple[Array, Array]],
    pool: Pool,
    own_std: Array,
) -> list[_Unseen]:
    """Each of these effects as it may be there unseen; `draws` as `unseen_draws` gives them.

    The base model's parameters and gains may hide an effect, but in the data so far and in those to
    come alike.
    """
    problem, data, base = findings.problem, pool.observations, findings.hypotheses.base
    predictor = Predictor(problem.predictor.description, data, problem.predictor.free)
    inside, scale = (
        np.abs(base.fit.vector) < FARTHEST,
        np.sqrt(base.fit.scale2),
    )  # what is at its end stays there
    here, slopes = _mean_and_slopes(predictor, base, base.fit.vector)
    sure = np.where(
        np.isfinite(here) & np.all(np.isfinite(slopes), axis=1), 1.0 / (own_std * scale), 0.0
    )
    gains = _session_gains(data)
    hides = sure[:, None] * np.nan_to_num(np.hstack([gains, slopes[:, inside]]))
    hid = np.pad(base.fit.jacobian[:, inside] / scale, ((0, 0), (gains.shape[1], 0)))
    found = []
    for kind, (vectors, signatures) in draws.items():
        difference = predictor.less(predictor.predicted((kind,), vectors), here)
        adds = np.where(np.isfinite(difference), sure * difference, 0.0)
        so_far = nothing(hides.shape[1]) + information_of(signatures, hid)
        blocks = by_block(adds, hides, pool.block, pool.cost_s.size)
        found.append(_Unseen((base.name, kind.name), so_far, blocks))
    return found


def _mean_and_spread(
    predictor: Predictor, candidate: Candidate, vector: Array
) -> tuple[Array, Array]:
    """What a model predicts at a vector [n], and columns [n, k] of what the data leave free in its
    parameters.
    """
    mean, slopes = _mean_and_slopes(predictor, candidate, vector)
    return mean, slopes @ np.linalg.cholesky(candidate.fit.covariance + 1e-12 * np.eye(vector.size))


def _mean_and_slopes(
    predictor: Predictor, candidate: Candidate, vector: Array
) -> tuple[Array, Array]:
    """What a model predicts at a vector [n], and how it changes with the vector [n, k]."""
    values = predictor.predicted(
        candidate.kinds, np.vstack([vector, vector + STEP * np.eye(vector.size)])
    )
    return values[0], (values[1:] - values[0]).T / STEP


def _of_interventions(pool: Pool) -> NDArray[np.bool_]:
    """Which blocks are measured once somebody has done something."""
    done = pool.observations.intervention
    acts = np.zeros(pool.cost_s.size, dtype=bool)
    if done is not None:
        acts[pool.block[done != NOTHING]] = True
    return acts


def leading(findings: Findings) -> list[tuple[Candidate, float]]:
    """The models to tell apart with their probabilities: the chosen, what it is confused with, then
    the likeliest.
    """
    verdict, found = findings.verdict, findings.hypotheses
    probability = verdict.posterior.shares
    alike = {name for names in verdict.group.values() for name in names}
    fitted = [c for c in (found.base, *found.singles) if c.kinds != verdict.chosen.kinds]
    fitted.sort(key=lambda c: (c.name not in alike, -probability[c.name]))
    own = [probability[kind.name] for kind in verdict.chosen.kinds]
    chosen = (verdict.chosen, sum(own) if own else probability[verdict.chosen.name])
    return [chosen, *((c, probability[c.name]) for c in fitted[: MODELS - 1])]


def _pairs(
    findings: Findings, leaders: Sequence[tuple[Candidate, float]], pool: Pool, own_std: Array
) -> list[Pair]:
    """Every two models, weighed by the product of their probabilities.

    The data so far are taken as what the first model predicts, and each other model is fitted to
    them. No measurement separates it in what it can imitate there and in the pool.
    """
    problem, data, first = findings.problem, pool.observations, leaders[0][0]
    predictor = Predictor(problem.predictor.description, data, problem.predictor.free)
    std = own_std * np.sqrt(findings.verdict.chosen.fit.scale2)
    means, spreads = [], []
    for candidate, _ in leaders:
        vector = (
            candidate.fit if candidate is first else imitate(problem, first.fit, candidate)
        ).vector
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
        pairs.append(
            Pair((leaders[i][0].name, leaders[j][0].name), weight, blocks, nothing(spread.shape[1]))
        )
    return pairs


def _own_std(findings: Findings, before: Measurements, pool: Pool) -> Array:
    """Noise of observations to come: the median of that witness's so far, or what is usual of such
    an instrument.

    Of the mean of all readings.
    """
    noise, data = findings.problem.noise, pool.observations
    std = np.empty(data.count)
    for i in data.witnesses:
        seen = noise.own_std[before.of(i)]
        single = np.median(seen) if seen.size else WITNESSES[i].usual_std or USUAL_STD
        std[data.of(i)] = single / np.sqrt(pool.repeats)
    return std


def _session_gains(data: Measurements) -> Array:
    """Columns per witness and session to come, with what its gain and its touch's area may be."""
    group = np.unique(data.group, return_inverse=True)[1].ravel()
    here = group[:, None] == np.arange(group.max() + 1)
    return np.hstack([np.where(here, std[:, None], 0.0) for std in shared_std(data).T])
