"""The rules of a challenge: what answers are worth, from what was hidden.

`docs/challenge.md` says them in words.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from statistics import median
from typing import Any, NamedTuple

import numpy as np

from haptic_driver.lab.challenge.answers import Answer, Region
from model.diagnosis.hidden import NO_TRACE
from model.support.arrays import Array, Mask

VISIBLE = 75.0  # lambda from which an effect counts as visible
BINS = 10  # of stated probabilities


@dataclass(frozen=True)
class Truth:
    """What was hidden in one set, and of its n rows of friction how much that changed it.

    `visibility` is the lambda of the least visible effect. `columns` [n], `change` [n] and `noise`
    [n] are of those rows, the last two relative to friction. `finger` are its own numbers. `unseen`
    [m] is friction without noise at settings that were not measured, `unseen_change` [m] by what
    share of the rest the hidden changes it there.
    """

    effects: frozenset[str]
    in_catalogue: bool
    visibility: float
    columns: Mapping[str, Array]
    change: Array
    noise: Array
    finger: Mapping[str, float] = field(default_factory=dict)
    unseen: Array = field(default_factory=lambda: np.zeros(0))
    unseen_change: Array = field(default_factory=lambda: np.zeros(0))

    @property
    def is_visible(self) -> bool:
        return self.visibility >= VISIBLE

    @property
    def changed(self) -> Mask:
        """The rows that are changed by more than their noise."""
        return np.abs(self.change) > self.noise

    @property
    def strength(self) -> float:
        """Root mean square of the relative change."""
        return float(np.sqrt(np.mean(self.change**2))) if self.change.size else 0.0


class Judged(NamedTuple):
    """The truth about a set, and what was answered."""

    truth: Truth
    got: Answer


class Rate(NamedTuple):
    """How often something `holds` among the sets that it is asked of."""

    key: str
    said: str
    asked: Callable[[Truth], bool]
    holds: Callable[[Judged], bool]


def _is_known(count: int) -> Callable[[Truth], bool]:
    """Whether so many effects of the catalogue are hidden, and nothing else."""
    return lambda truth: len(truth.effects) == count and truth.in_catalogue


def _is_visible_single(truth: Truth) -> bool:
    return _is_known(1)(truth) and truth.is_visible


def _is_named(one: Judged) -> bool:
    return one.got.verdict == "named"


def _is_named_rightly(one: Judged) -> bool:
    return _is_named(one) and set(one.got.effects) == one.truth.effects


def _is_found(one: Judged) -> bool:
    return one.truth.effects <= set(one.got.effects)


RATES = (
    Rate("single_named", "visible single effects named", _is_visible_single, _is_named_rightly),
    Rate("single_found", "the same, right or in the list", _is_visible_single, _is_found),
    Rate("pair_named", "pairs, both named", _is_known(2), _is_named_rightly),
    Rate("pair_found", "pairs, both named or in the list", _is_known(2), _is_found),
    Rate(
        "wrong_name",
        "wrong names, of all sets",
        lambda truth: True,
        lambda one: _is_named(one) and not set(one.got.effects) <= one.truth.effects,
    ),
    Rate(
        "nothing_named",
        "nothing hidden, a name or a list",
        lambda truth: not truth.effects,
        lambda one: bool(one.got.effects),
    ),
    Rate(
        "outside_unknown",
        "of no catalogue and visible, left without a name (unknown)",
        lambda truth: not truth.in_catalogue and truth.is_visible,
        lambda one: one.got.verdict == "unknown",
    ),
    Rate(
        "outside_named",
        "of no catalogue, given a name",
        lambda truth: not truth.in_catalogue,
        _is_named,
    ),
)


def scores(answers: Mapping[str, Answer], truths: Mapping[str, Truth]) -> dict[str, Any]:
    """Everything as JSON can hold it, of the sets in `truths`; None where nothing was answered."""
    judged = [Judged(truth, answers.get(name, Answer())) for name, truth in truths.items()]
    given = [one for one in judged if one.got.verdict is not None]
    parts = ("verdict", "probability", "where", "strength", "finger", "predicted")
    return {
        "sets": len(truths),
        "answered": {
            part: sum(getattr(one.got, part) is not None for one in judged) for part in parts
        },
        "names": {rate.key: _share(rate, given) for rate in RATES},
        "place": _place(judged),
        "strength": _strength(judged),
        "proof": _proof(judged),
        "finger": _finger(judged),
        "calibration": _calibration(
            [
                (one.got.probability, is_right(one))
                for one in given
                if one.got.probability is not None
            ]
        ),
    }


def _share(rate: Rate, given: Sequence[Judged]) -> dict[str, int]:
    asked = [one for one in given if rate.asked(one.truth)]
    return {"count": sum(map(rate.holds, asked)), "of": len(asked)}


def is_right(one: Judged) -> bool:
    """Whether the verdict is true: all names are hidden, some of the list is, or what it says."""
    truth, got = one
    match got.verdict:
        case "named":
            return set(got.effects) <= truth.effects
        case "listed":
            return bool(truth.effects & set(got.effects))
        case "unknown":
            return not truth.in_catalogue
    return truth.visibility < NO_TRACE


def rows_in(regions: Sequence[Region], columns: Mapping[str, Array]) -> Mask:
    """The rows that lie in any of the regions; a region of frequencies has rows with voltage."""
    chosen = np.zeros(columns["voltage_v"].size, dtype=bool)
    for region in regions:
        inside = np.ones_like(chosen)
        for axis, (low, high) in region.items():
            inside &= (columns[axis] >= low) & (columns[axis] <= high)
        if "frequency_hz" in region:
            inside &= columns["voltage_v"] > 0.0
        chosen |= inside
    return chosen


def f1(chosen: Mask, true: Mask) -> float:
    """Harmonic mean of precision and recall."""
    return 2.0 * float(np.sum(chosen & true)) / float(np.sum(chosen) + np.sum(true))


def _place(judged: Sequence[Judged]) -> dict[str, Any]:
    """The mean F1 where some row is changed; elsewhere how often some row was called so."""
    asked = [
        (rows_in(one.got.where, one.truth.columns), one.truth.changed)
        for one in judged
        if one.got.where is not None
    ]
    found = [f1(chosen, true) for chosen, true in asked if true.any()]
    invented = [bool(chosen.any()) for chosen, true in asked if not true.any()]
    return {
        "f1": float(np.mean(found)) if found else None,
        "sets": len(found),
        "invented": {"count": sum(invented), "of": len(invented)},
    }


def _strength(judged: Sequence[Judged]) -> dict[str, Any]:
    """The median factor between stated and true strength, where something is hidden."""
    factors = [
        _factor(one.got.strength, one.truth.strength)
        for one in judged
        if one.got.strength is not None and one.truth.strength > 0.0
    ]
    return {"factor_off": median(factors) if factors else None, "sets": len(factors)}


def _factor(said: float, true: float) -> float:
    return max(said / true, true / said) if said > 0.0 else float("inf")


def _proof(judged: Sequence[Judged]) -> dict[str, Any]:
    """How far off predictions of settings are that were not measured, relative: the median over
    sets. Where something visible changes friction, the share of its change that they have.

    A factor that all settings share is free: gains of sessions hide it.
    """
    asked = [
        (float(np.std(np.log(one.got.predicted / one.truth.unseen))), one.truth)
        for one in judged
        if one.got.predicted is not None
    ]
    shares = [
        1.0 - error / float(np.std(np.log1p(truth.unseen_change)))
        for error, truth in asked
        if truth.is_visible and truth.changed.any()
    ]
    return {
        "error": median(error for error, _ in asked) if asked else None,
        "sets": len(asked),
        "share": median(shares) if shares else None,
        "visible": len(shares),
    }


def _finger(judged: Sequence[Judged]) -> dict[str, Any]:
    """How many standard deviations numbers of the finger are off where something is hidden: the
    median, of each and of all.
    """
    off = [
        (name, abs(value - one.truth.finger[name]) / std)
        for one in judged
        if one.truth.effects
        for name, (value, std) in (one.got.finger or {}).items()
    ]
    each = {name: median(x for other, x in off if other == name) for name in dict(off)}
    return {
        "off_std": median(x for _, x in off) if off else None,
        "beyond_two": {"count": sum(x > 2.0 for _, x in off), "of": len(off)},
        "each": each,
    }


def _calibration(stated: Sequence[tuple[float, bool]]) -> dict[str, Any]:
    """The expected calibration error, and what chance alone gives as many calibrated answers."""
    if not stated:
        return {"error": None, "by_chance": None, "sets": 0}
    probability = np.array([p for p, _ in stated])
    right = np.array([hit for _, hit in stated])
    chance = np.random.default_rng(0).random((1000, probability.size)) < probability
    errors = [_off(probability, hits) for hits in chance]
    return {
        "error": _off(probability, right),
        "by_chance": float(np.mean(errors)),
        "sets": len(stated),
    }


def _off(probability: Array, right: Mask) -> float:
    which = np.minimum((probability * BINS).astype(int), BINS - 1)
    return float(np.abs(np.bincount(which, probability - right)).sum() / probability.size)
