"""Which measurements tell the leading models apart soonest: blocks of settings, chosen one after the other.

Box and Hill's and Hunter and Reiner's discrimination: how far two models' predictions differ, in standard deviations,
once everything that is uncertain has been bent to hide it: both models' parameters, as far as the data so far leave
them free, and the gains of the sessions to come. Pairs count by the product of their probabilities, up to what makes a
name; a block counts by what it adds per second.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from model.diagnosis.data import Measurements
from model.diagnosis.fit import STEP
from model.diagnosis.naming import Candidate, imitate
from model.diagnosis.noise import shared_std
from model.diagnosis.space import Predictor
from model.diagnosis.verdict import APART
from model.diagnosis.witness import WITNESSES
from model.diagnosis.workflow import Diagnosis, Findings
from model.effects.interventions import NOTHING
from model.support.arrays import Array

MODELS = 6  # that take part
LEAST_WEIGHT = 1e-3  # of the first model and any other, beside the weightiest pair: each rival deserves a test
LEAST_GAIN = 0.01  # of all that is to be told: a block that adds less is not worth its time
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


class Choice(NamedTuple):
    """A block, the two models that it is for, and what it adds to their separation, in chi^2."""

    block: int
    separates: tuple[str, str]
    gain: float


class Design(NamedTuple):
    """The blocks to measure, in the order of their use, and what even the whole pool could do for each pair.

    `reach` is the expected separation, chi^2, of the first model from each other one, were everything measured.
    """

    choices: tuple[Choice, ...]
    reach: dict[str, float]


@dataclass(frozen=True)
class _Told:
    """What measurements tell of one pair of models: the normal equations of everything that could hide a difference.

    `normal` [..., k, k], `moment` [..., k], `square` [...]; in standard deviations.
    """

    normal: Array
    moment: Array
    square: Array

    def __add__(self, more: _Told) -> _Told:
        """Both together."""
        return _Told(self.normal + more.normal, self.moment + more.moment, self.square + more.square)

    def __getitem__(self, which: int | NDArray[np.intp]) -> _Told:
        """Some of the first axis."""
        return _Told(self.normal[which], self.moment[which], self.square[which])

    def only(self, these: NDArray[np.bool_]) -> _Told:
        """What these of the first axis tell; the others nothing."""
        square = np.where(these, self.square, 0.0)
        return _Told(self.normal * these[:, None, None], self.moment * these[:, None], square)

    def chi2(self) -> Array:
        """The separation that is left once everything has been bent to hide it."""
        hidden = np.linalg.solve(self.normal, self.moment[..., None])[..., 0]
        return np.asarray(self.square - np.sum(self.moment * hidden, axis=-1))


def _nothing(size: int) -> _Told:
    """What is told before anything is measured: every parameter has its prior standard deviation of 1."""
    return _Told(np.eye(size), np.zeros(size), np.zeros(()))


@dataclass
class _Pair:
    """Two models, what they weigh, what each block would tell of them, and what is told by those chosen so far."""

    names: tuple[str, str]
    weight: float
    blocks: _Told
    told: _Told
    reached: float = 0.0

    def reach(self) -> float:
        """Separation with every block."""
        every = (np.sum(values, axis=0) for values in (self.blocks.normal, self.blocks.moment, self.blocks.square))
        return float((_nothing(self.blocks.moment.shape[1]) + _Told(*every)).chi2())

    def choose(self, block: int) -> float:
        """Take a block; returns what it adds."""
        before = self.reached
        self.told = self.told + self.blocks[block]
        self.reached = float(self.told.chi2())
        return self.reached - before


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
    enough, acts = APART, _of_interventions(pool)
    reach = {pair.names[1]: pair.reach() for pair in pairs if pair.names[0] == leaders[0][0].name}
    for pair in pairs:
        if frozenset(pair.names) in stubborn:
            asked = replace(pair, blocks=pair.blocks.only(acts))
            pair.blocks = asked.blocks if asked.reach() >= APART else pair.blocks
    left, left_s = set(range(pool.cost_s.size)), most_s
    choices: list[Choice] = []
    while len(choices) < most:
        possible = np.array(sorted(b for b in left if pool.cost_s[b] <= left_s), dtype=np.intp)
        if not possible.size:
            break
        reached = np.array([(pair.told + pair.blocks[possible]).chi2() for pair in pairs])
        so_far = np.array([[pair.reached] for pair in pairs])
        gains = np.minimum(reached, enough) - np.minimum(so_far, enough)
        weighed = np.array([[pair.weight] for pair in pairs]) * gains
        if weighed.sum(axis=0).max() < LEAST_GAIN * enough * sum(pair.weight for pair in pairs):
            break
        best = int(np.argmax(weighed.sum(axis=0) / pool.cost_s[possible]))
        block, first = int(possible[best]), int(np.argmax(weighed[:, best]))
        added = [pair.choose(block) for pair in pairs]
        choices.append(Choice(block, pairs[first].names, added[first]))
        left.discard(block)
        left_s -= float(pool.cost_s[block])
    return Design(tuple(choices), reach)


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


def _pairs(findings: Findings, leaders: Sequence[tuple[Candidate, float]], pool: Pool, own_std: Array) -> list[_Pair]:
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
        values = predictor.predicted(candidate.kinds, np.vstack([vector, vector + STEP * np.eye(vector.size)]))
        root = np.linalg.cholesky(candidate.fit.covariance + 1e-12 * np.eye(vector.size))
        means.append(values[0])
        spreads.append((values[1:] - values[0]).T / STEP @ root)
    usable = np.all(np.isfinite(np.column_stack([*means, *spreads])), axis=1)
    sure = np.where(usable, 1.0 / std, 0.0)[:, None]
    gains = _session_gains(data)
    weights = [a[1] * b[1] for a, b in combinations(leaders, 2)]
    floor = LEAST_WEIGHT * max(weights, default=1.0) or 1.0
    pairs = []
    for weight, (i, j) in zip(weights, combinations(range(len(leaders)), 2), strict=True):
        difference = np.nan_to_num(predictor.less(means[i], means[j]))[:, None]
        spread = np.nan_to_num(np.concatenate([gains, spreads[i], spreads[j]], axis=1))
        blocks = _by_block(sure * difference, sure * spread, pool)
        names = (leaders[i][0].name, leaders[j][0].name)
        pairs.append(_Pair(names, max(weight, floor if i == 0 else 0.0), blocks, _nothing(spread.shape[1])))
    return pairs


def _by_block(difference: Array, spread: Array, pool: Pool) -> _Told:
    """What each block tells, from differences [n, 1] and what may hide them [n, k], in standard deviations."""
    rows = [pool.block == b for b in range(pool.cost_s.size)]
    return _Told(
        np.array([spread[here].T @ spread[here] for here in rows]),
        np.array([(spread[here].T @ difference[here])[:, 0] for here in rows]),
        np.array([np.sum(difference[here] ** 2) for here in rows]),
    )


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
