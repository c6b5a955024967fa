"""Most voltages of a surface need not be solved: answers that change smoothly come from those at every fourth.

Whether they do is looked at everywhere; where not, as at a fold or where an amplifier saturates, all are solved.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from model.compiled import kernel
from model.dielectrics import Array
from model.gain_curves import Integers

STRIDE = 4  # voltages from one solved first to the next
AROUND = 5  # solved voltages around a place: a quartic
SMOOTH = 5e-5  # of an answer: what a cubic through four of five may miss at the middle one; a quartic misses far less


class Between(NamedTuple):
    """Answers at all voltages from those at the voltages solved first.

    `solved` [k]: the numbers v of these; `number` [v]: the k of a solved voltage, else -1; `start` [k]: the first of
    the five solved ones around the interval after k, and `other` [k]: of five more beside these; `weight` [v, 5]: of
    the five at a voltage of the interval; `miss` [k, 5]: of what a cubic misses in the middle of the five from k on.
    """

    solved: Integers
    number: Integers
    start: Integers
    other: Integers
    weight: Array
    miss: Array


@lru_cache(maxsize=8)
def between(count: int) -> Between:
    """Which of `count` voltages to solve first: all of them where they are few."""
    stride = STRIDE if count > AROUND * STRIDE else 1
    solved = np.unique(np.append(np.arange(0, count, stride), count - 1))
    number = np.full(count, -1)
    number[solved] = np.arange(solved.size)
    windows = max(solved.size - AROUND + 1, 0)
    interval, last = np.arange(solved.size), max(windows - 1, 0)
    start, other = np.clip(interval - 1, 0, last), np.clip(interval - 2, 0, last)
    other = np.where(other != start, other, np.clip(np.where(interval < 2, start + 1, start - 1), 0, last))
    weight, miss = np.zeros((count, AROUND)), np.zeros((windows, AROUND))
    for k in range(solved.size - 1 if windows else 0):
        inside = np.arange(solved[k], solved[k + 1])
        weight[inside] = _lagrange(solved[start[k] : start[k] + AROUND], inside)
    middle = np.arange(AROUND) == AROUND // 2
    for w in range(windows):
        around = solved[w : w + AROUND]
        miss[w, ~middle] = _lagrange(around[~middle], around[middle])
        miss[w, middle] = -1.0
    return Between(solved, number, start, other, weight, miss)


def _lagrange(nodes: Integers, x: Integers) -> Array:
    """Weights [x, nodes] of the polynomial through the values at the nodes."""
    apart = np.where(np.eye(nodes.size, dtype=np.bool_), 1, nodes[:, None] - nodes)
    factors = np.where(np.eye(nodes.size, dtype=np.bool_), 1.0, (x[:, None, None] - nodes) / apart)
    return np.asarray(np.prod(factors, axis=2))


@kernel
def fill_between(way: Between, values: Array, missed: Array, rough: Integers) -> int:
    """Fill in the `values` [v, c]; voltages where a column is not smooth are listed in `rough`, and counted.

    What is not a number is not smooth. Rough values are guesses. `missed` [k] is a work array.
    """
    solved, _, start, other, weight, miss = way
    count, columns = 0, values.shape[1]
    for w in range(miss.shape[0]):
        missed[w] = 0.0
        for c in range(columns):
            off = 0.0
            for b in range(AROUND):
                off += miss[w, b] * values[solved[w + b], c]
            share = abs(off / values[solved[w + AROUND // 2], c])
            missed[w] = np.inf if math.isnan(share) else max(missed[w], share)
    for k in range(solved.size - 1):
        low, high, w = solved[k], solved[k + 1], start[k]
        if high == low + 1:
            continue
        most = max(missed[w], missed[other[k]])  # a kink may hide from one five, not from two
        if k == 0 or high == values.shape[0] - 1:
            most *= 6.0  # the value at an end counts for a sixth in the middle, but whole beside it
        v0, v1, v2, v3, v4 = solved[w], solved[w + 1], solved[w + 2], solved[w + 3], solved[w + 4]
        for v in range(low + 1, high):
            w0, w1, w2, w3, w4 = weight[v, 0], weight[v, 1], weight[v, 2], weight[v, 3], weight[v, 4]
            for c in range(columns):
                values[v, c] = (
                    w0 * values[v0, c] + w1 * values[v1, c] + w2 * values[v2, c]
                    + w3 * values[v3, c] + w4 * values[v4, c]
                )  # fmt: skip
            if not most <= SMOOTH:
                rough[count] = v
                count += 1
    return count
