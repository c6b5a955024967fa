"""Most points of a surface need not be solved: answers that change smoothly come from those around them.

Whether they do is looked at everywhere; where not, as at a fold or where an amplifier saturates, points are solved:
every second one first, and the rest where those are not smooth either.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from model.compiled import copy, kernel
from model.dielectrics import Array
from model.gain_curves import Flags, Integers

AROUND = 5  # solved places around one that is not: a quartic
CHECKED = 6  # solved places of which the quartic through five is to find the other
SMOOTH = 1e-4  # of an answer: what it may miss there; in between, nearer to its five, it misses about a tenth of that
NEARER = 3.0  # times as much counts what is missed at the second step, where a kink makes less difference


class Between(NamedTuple):
    """Answers at all places on an axis from those at some.

    `solved` [k]: the numbers v of these; `finer`: the stride of those to solve next where it is not smooth; `start`
    [k]: the first of the five solved ones around the interval after k; `weight` [v, 5]: their weights at a place of it;
    `miss` [w, 6]: the weights of what a quartic misses at one of the six from w on; `check` [k, 2]: which w tell about
    an interval.
    """

    solved: Integers
    finer: int
    start: Integers
    weight: Array
    miss: Array
    check: Integers


@lru_cache(maxsize=16)
def between(count: int, stride: int, smooth: float = SMOOTH) -> Between:
    """Of `count` places every `stride` is known; all of them where they are few. `smooth`: instead of `SMOOTH`."""
    stride = stride if count > CHECKED * stride else 1
    solved = np.unique(np.append(np.arange(0, count, stride), count - 1))
    intervals, weight = np.arange(solved.size - 1 if stride > 1 else 0), np.zeros((count, AROUND))
    start = np.clip(intervals - 1, 0, max(solved.size - AROUND, 0))
    for k in intervals:
        inside = np.arange(solved[k], solved[k + 1])
        weight[inside] = _lagrange(solved[start[k] : start[k] + AROUND], inside)
    miss = np.zeros((max(solved.size - CHECKED + 1, 0) if stride > 1 else 0, CHECKED))
    sought = np.arange(CHECKED) == CHECKED // 2 - 1
    for w in range(len(miss)):
        six = solved[w : w + CHECKED]
        miss[w, ~sought] = _lagrange(six[~sought], six[sought])
        miss[w, sought] = -1.0
    if len(miss):
        miss[[0, 1, -2, -1]] *= 10.0  # a value at an end counts for a tenth in the middle, but whole beside it
        miss *= SMOOTH / smooth
    # a kink may hide from one six, not from two
    last = max(len(miss) - 1, 0)
    nearest, other = np.clip(intervals - 2, 0, last), np.clip(intervals - 3, 0, last)
    other = np.where(other != nearest, other, np.clip(np.where(intervals < CHECKED // 2, 1, last - 1), 0, last))
    return Between(solved, max(stride // 2, 1), start, weight, miss, np.stack([nearest, other], axis=1))


def twice(count: int, stride: int) -> tuple[Between, Between]:
    """From every `stride` of the places to every second of these in between, and from there to all."""
    first = between(count, stride)
    return first, between(count, first.finer, SMOOTH / NEARER)


def _lagrange(nodes: Integers, x: Integers) -> Array:
    """Weights [x, nodes] of the polynomial through the values at the nodes."""
    apart = np.where(np.eye(nodes.size, dtype=np.bool_), 1, nodes[:, None] - nodes)
    factors = np.where(np.eye(nodes.size, dtype=np.bool_), 1.0, (x[:, None, None] - nodes) / apart)
    return np.asarray(np.prod(factors, axis=2))


@kernel
def fill_between(way: Between, values: Array, uneven: Flags) -> None:
    """Fill in the `values` [v, c], and mark in `uneven` [w, c] what is not smooth there, or not a number.

    What is filled in next to these is no more than a guess.
    """
    solved, _, start, weight, miss, _ = way
    columns = values.shape[1]
    for w in range(miss.shape[0]):
        count = 0  # most rows have none, and counting is faster than marking
        for c in range(columns):
            count += _is_uneven(values, solved, miss, w, c)
        if count > 0:
            for c in range(columns):
                uneven[w, c] |= _is_uneven(values, solved, miss, w, c)
    for k in range(start.size):
        w = start[k]
        v0, v1, v2, v3, v4 = solved[w], solved[w + 1], solved[w + 2], solved[w + 3], solved[w + 4]
        for v in range(solved[k] + 1, solved[k + 1]):
            w0, w1, w2, w3, w4 = weight[v, 0], weight[v, 1], weight[v, 2], weight[v, 3], weight[v, 4]
            for c in range(columns):
                values[v, c] = (
                    w0 * values[v0, c] + w1 * values[v1, c] + w2 * values[v2, c]
                    + w3 * values[v3, c] + w4 * values[v4, c]
                )  # fmt: skip


@kernel
def _is_uneven(values: Array, solved: Integers, miss: Array, w: int, c: int) -> bool:
    """Whether the quartic through five of the six solved places from `w` on misses the other."""
    off = (
        miss[w, 0] * values[solved[w], c] + miss[w, 1] * values[solved[w + 1], c]
        + miss[w, 2] * values[solved[w + 2], c] + miss[w, 3] * values[solved[w + 3], c]
        + miss[w, 4] * values[solved[w + 4], c] + miss[w, 5] * values[solved[w + 5], c]
    )  # fmt: skip
    return not abs(off) <= SMOOTH * abs(values[solved[w + 2], c])


@kernel
def rough_places(way: Between, uneven: Flags, wanted: Flags, rough: Integers) -> int:
    """List in `rough` the places to solve next, mark the columns at each in `wanted` [v, c], and count the places."""
    count, columns = 0, uneven.shape[1]
    for k in range(way.start.size):
        one, other = way.check[k, 0], way.check[k, 1]
        first = way.solved[k] + 1
        found = False
        for c in range(columns):
            wanted[first, c] = uneven[one, c] | uneven[other, c]
            found |= wanted[first, c]
        if found:
            for v in range(first, way.solved[k + 1]):
                if v % way.finer == 0:
                    copy(wanted[first], wanted[v])
                    rough[count] = v
                    count += 1
    return count
