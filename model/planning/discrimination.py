"""Which blocks of observations tell models apart soonest, of arrays alone: what a block is worth,
and a greedy choice.

Box and Hill's and Hunter and Reiner's discrimination (Technometrics 9, 1967, 57; 7, 1965, 305). It
is how far two models' predictions differ, in standard deviations, once every uncertain quantity has
been fitted to hide it. Pairs count by the product of their probabilities, up to what makes a name;
a block counts by what it adds per cost.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations, product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from model.support.arrays import Array

LEAST_WEIGHT = 1e-3  # of the first model and any other, beside the weightiest pair: each is tested
# chi^2, of the mean of all pairs: a block that adds less is not worth its cost; 16 shows an effect
LEAST_GAIN = 0.16


class Choice(NamedTuple):
    """A block, the two models that it is for, and what it adds to their separation, in chi^2."""

    block: int
    separates: tuple[str, str]
    gain: float


@dataclass(frozen=True)
class Information:
    """It holds what measurements say about one pair of models.

    These are the normal equations of all quantities that could hide a difference between the two.

    `normal` [..., k, k], `moment` [..., k], `square` [...]; in standard deviations.
    """

    normal: Array
    moment: Array
    square: Array

    def __add__(self, more: Information) -> Information:
        return Information(
            self.normal + more.normal, self.moment + more.moment, self.square + more.square
        )

    def __getitem__(self, which: int | NDArray[np.intp]) -> Information:
        """Some of the first axis."""
        return Information(self.normal[which], self.moment[which], self.square[which])

    def only(self, these: NDArray[np.bool_]) -> Information:
        """What these of the first axis tell; the others nothing."""
        square = np.where(these, self.square, 0.0)
        return Information(self.normal * these[:, None, None], self.moment * these[:, None], square)

    def all(self) -> Information:
        """All of the first axis together."""
        return Information(
            self.normal.sum(axis=0), self.moment.sum(axis=0), self.square.sum(axis=0)
        )

    def chi2(self) -> Array:
        """The separation that is left once every uncertain quantity has been fitted to hide it."""
        hidden = np.linalg.solve(self.normal, self.moment[..., None])[..., 0]
        return np.asarray(self.square - np.sum(self.moment * hidden, axis=-1))


def nothing(size: int) -> Information:
    """The information before anything is measured: every uncertain quantity has its standard
    deviation of 1.
    """
    return Information(np.eye(size), np.zeros(size), np.zeros(()))


def information_of(difference: Array, spread: Array) -> Information:
    """What n observations tell of a pair, `difference` [n], or of m [m, n]; `spread` [n, k] as for
    `by_block`.
    """
    return Information(spread.T @ spread, difference @ spread, np.sum(difference**2, axis=-1))


def by_block(difference: Array, spread: Array, block: NDArray[np.intp], count: int) -> Information:
    """What each of `count` blocks adds to the separation of a pair, or of m.

    `difference` [n] or [m, n] is that of the predictions. `spread` [n, k] is what may hide it, a
    column per uncertain quantity moved by its own standard deviation. Both are in standard
    deviations of the noise. `block` [n] says whose each observation is.
    """
    each = [
        information_of(difference[..., here], spread[here])
        for here in (block == b for b in range(count))
    ]
    return Information(
        *(
            np.array(part)
            for part in zip(*((t.normal, t.moment, t.square) for t in each), strict=True)
        )
    )


def with_each(so_far: Information, blocks: Information) -> Array:
    """The separation of m pairs with each of B blocks [B, m]; `blocks` as `by_block` gives them."""
    moment = so_far.moment + blocks.moment
    hidden = np.linalg.solve(so_far.normal + blocks.normal, np.swapaxes(moment, 1, 2))
    chi2 = so_far.square + blocks.square - np.sum(moment * np.swapaxes(hidden, 1, 2), axis=2)
    return np.asarray(chi2)


def most_by_one(so_far: Information, blocks: Information) -> Array:
    """The separation of m pairs [m] with that block which adds most to each."""
    return np.asarray(with_each(so_far, blocks).max(axis=0))


def by_all(so_far: Information, blocks: Information) -> Array:
    """The separation of m pairs [m] with all blocks."""
    return (so_far + blocks.all()).chi2()


@dataclass
class Pair:
    """Two models, their weights, what each block would add to their separation, and what the chosen
    blocks have added.

    `information` begins with the information of the present data, or `nothing`.
    """

    names: tuple[str, str]
    weight: float
    blocks: Information
    information: Information

    @property
    def reached(self) -> float:
        """Separation by the present information."""
        return float(self.information.chi2())

    def reach(self) -> float:
        """Separation with every block, before any is chosen."""
        return float((self.information + self.blocks.all()).chi2())

    def choose(self, block: int) -> float:
        """Take a block; returns what it adds."""
        before = self.reached
        self.information = self.information + self.blocks[block]
        return self.reached - before


def weights(probabilities: Sequence[float]) -> dict[tuple[int, int], float]:
    """What every two models weigh, the first of all with each other one at least a little."""
    products = {
        (i, j): probabilities[i] * probabilities[j]
        for i, j in combinations(range(len(probabilities)), 2)
    }
    floor = LEAST_WEIGHT * max(products.values(), default=1.0) or 1.0
    return {(i, j): max(weight, floor if i == 0 else 0.0) for (i, j), weight in products.items()}


def choose(
    pairs: Sequence[Pair],
    cost: Array,
    most: int,
    most_cost: float,
    enough: float,
    least: float = LEAST_GAIN,
    first: Sequence[Choice] = (),
) -> list[Choice]:
    """At most `most` of the blocks, that together cost at most `most_cost`, those that tell most
    per cost first.

    `cost` [blocks]; each pair's separation counts up to `enough`, in chi^2. A block that adds less
    than `least`, of the pairs' weighted mean, is not chosen. It begins with what was chosen
    `first`, for other pairs.
    """
    left, choices = set(range(cost.size)) - {choice.block for choice in first}, list(first)
    most_cost -= float(sum(cost[choice.block] for choice in first))
    for pair, choice in product(pairs, first):
        pair.choose(choice.block)
    weight = np.array([[pair.weight] for pair in pairs])
    while pairs and len(choices) < most:
        possible = np.array(sorted(b for b in left if cost[b] <= most_cost), dtype=np.intp)
        if not possible.size:
            break
        reached = np.array([(pair.information + pair.blocks[possible]).chi2() for pair in pairs])
        so_far = np.array([[pair.reached] for pair in pairs])
        weighed = weight * (np.minimum(reached, enough) - np.minimum(so_far, enough))
        if weighed.sum(axis=0).max() < least * weight.sum():
            break
        best = int(np.argmax(weighed.sum(axis=0) / cost[possible]))
        block, chief = int(possible[best]), int(np.argmax(weighed[:, best]))
        added = [pair.choose(block) for pair in pairs]
        choices.append(Choice(block, pairs[chief].names, added[chief]))
        left.discard(block)
        most_cost -= float(cost[block])
    return choices
