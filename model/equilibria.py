"""Where the closed loop is at rest: equilibria on a curve of the gain, and next to a known one.

Pressures are told by q = sqrt(p), in which curves are nearly straight: values at five nodes around give a power series.
An answer is a row of numbers, see `search`.
"""

from __future__ import annotations

import math

import numpy as np

from model.compiled import inlined, kernel
from model.dielectrics import Array
from model.pressure import TOLERANCE, divider, gain_of

FOLD_STEPS = 2  # per pressure of a curve, at which the slope is looked at for a turn of V(p_e)
BISECTIONS = 50
CLOSE = 1e-5  # of q: the last step of an answer that was followed, whose gain is led on from that before it
LEAP = 1.05  # in q: where the gain changes with the voltage, an answer this near is on the same branch
FEW_STEPS = 8  # in which such an answer is found, if there is one
ANSWER = 7  # numbers of an answer

Spacing = tuple[float, ...]  # 4 x 5, see `to_series`
Series = tuple[float, float, float, float, float]


def to_series(q_node: Array) -> Spacing:
    """How the values at five nodes make a power series from the first, the distance to the second being 1.

    The same around every node, for they lie evenly in the logarithm.
    """
    q = q_node[:5]
    rows = np.linalg.inv(np.vander((q - q[0]) / (q[1] - q[0]), increasing=True))
    return tuple(rows[1:].ravel().tolist())


@kernel
def node_below(q_node: Array, q: float) -> int:
    """First of the five nodes around the place `q`."""
    above = 0
    while above < q_node.size and q_node[above] <= q:
        above += 1
    return min(max(above - 2, 0), q_node.size - 5)


@kernel
def cell_of(q_node: Array, q: float, near: int, first: int, last: int) -> int:
    """The cell of a curve that holds `q`, or the last one on its side, looked for from one `near` it."""
    cell = min(max(near, first), last - 1)
    while cell < last - 1 and q > q_node[cell + 1]:
        cell += 1
    while cell > first and q < q_node[cell]:
        cell -= 1
    return cell


@kernel
def stencil(cell: int, first: int, last: int) -> int:
    """First of the five nodes around a cell."""
    return min(max(cell - 1, first), last - 4)


@kernel
def power_series(spacing: Spacing, y: Array, i: int) -> Series:
    """The power series through the values at five nodes from `i` on."""
    m, y0, y1, y2, y3, y4 = spacing, y[i], y[i + 1], y[i + 2], y[i + 3], y[i + 4]
    return (
        y0,
        m[0] * y0 + m[1] * y1 + m[2] * y2 + m[3] * y3 + m[4] * y4,
        m[5] * y0 + m[6] * y1 + m[7] * y2 + m[8] * y3 + m[9] * y4,
        m[10] * y0 + m[11] * y1 + m[12] * y2 + m[13] * y3 + m[14] * y4,
        m[15] * y0 + m[16] * y1 + m[17] * y2 + m[18] * y3 + m[19] * y4,
    )


@kernel
def at(series: Series, t: float) -> tuple[float, float]:
    """Value and slope of a power series at the place `t`."""
    c0, c1, c2, c3, c4 = series
    return (
        c0 + t * (c1 + t * (c2 + t * (c3 + t * c4))),
        c1 + t * (2.0 * c2 + t * (3.0 * c3 + t * 4.0 * c4)),
    )


@kernel
def fold(
    gain: Array, q_node: Array, per_q: Array, spacing: Spacing, first: int, last: int, base: float
) -> tuple[float, float]:
    """q at which V(p_e) first turns back, and the gain there; that of the last node where it never does."""
    for cell in range(first, last):
        i = stencil(cell, first, last)
        series = power_series(spacing, gain, i)
        step = (q_node[cell + 1] - q_node[cell]) / FOLD_STEPS
        for k in range(FOLD_STEPS):
            q = q_node[cell] + (k + 1) * step
            if q * q > base and _turned(series, q_node[i], per_q[i], q, base):
                low, high = max(q - step, math.sqrt(base)), q
                for _ in range(BISECTIONS):
                    q = 0.5 * (low + high)
                    if _turned(series, q_node[i], per_q[i], q, base):
                        high = q
                    else:
                        low = q
                return low, at(series, (low - q_node[i]) * per_q[i])[0]
    return q_node[last], gain[last]


@kernel
def _turned(series: Series, start: float, per_q: float, q: float, base: float) -> bool:
    """Whether V(p_e) falls at q: d ln(gain) is over d ln(p - base)."""
    gain, slope = at(series, (q - start) * per_q)
    return slope * per_q * (q * q - base) > 2.0 * q * gain


@inlined
def search(
    gain: Array, q_node: Array, per_q: Array, spacing: Spacing, first: int, last: int, from_node: int, to_node: int,
    base: float, square: float, low: float, high: float, guess: float, steps: int, answer: Array, n: int,
) -> bool:  # fmt: skip
    """The equilibrium between `low` and `high`, in q; False, and `answer` as it was, where Newton's method finds none.

    The curve is known from `from_node` to `to_node`; an answer elsewhere is none. The search starts at the `guess`, or
    where that is 0 where the last voltage's answer leads along its slope, with what that had missed before. `answer`
    [n]: q (negative for none), base, mean square, gain, compliance dq/dp, that miss, and the cell of the curve.
    """
    predicted, missed, cell = low, 0.0, first
    if answer[n, 0] > 0.0:
        missed, cell = answer[n, 5], int(answer[n, 6])
        predicted = answer[n, 0] + (answer[n, 3] * (square - answer[n, 2]) + base - answer[n, 1]) * answer[n, 4]
    q = guess if guess > 0.0 else predicted + missed
    if not low <= q <= high:
        q = low
    for _ in range(steps):
        cell = cell_of(q_node, q, cell, first, last)
        i = stencil(cell, first, last)
        if i < from_node or i + 4 > to_node:
            return False
        value, slope = at(power_series(spacing, gain, i), (q - q_node[i]) * per_q[i])
        slope *= per_q[i]
        excess = base + square * value - q * q
        compliance = 1.0 / (2.0 * q - square * slope)
        change = excess * compliance
        if change * change <= TOLERANCE * q * q and compliance > 0.0:
            # what Newton's method leaves is of the order of its last step's square
            answer[n, 5] = q + change - predicted if answer[n, 0] > 0.0 else 0.0
            answer[n, 0], answer[n, 1], answer[n, 2] = q + change, base, square
            answer[n, 3], answer[n, 4], answer[n, 6] = value + slope * change, compliance, cell
            return True
        if excess > 0.0:
            low = q
        else:
            high = q
        q += change
        if not low < q < high:
            q = 0.5 * (low + high)
    return False


@inlined
def follow(
    flat: Array, mass: Array, mass_below: Array, gap: Array, p_scale: float, h_scale: float, h: complex,
    k_gap: complex, bypass: complex, leak: complex, shift: float, reach: float, base: float, square: float,
    q_node: Array, guess: float, answer: Array, n: int, out: Array,
) -> bool:  # fmt: skip
    """The equilibrium of single conditions next to where the last answer leads; False, and `answer` as it was, if none.

    By the secant method, starting with the last compliance, at a `guess` as in `search`. `out` is left with what
    `lookup` found there.
    """
    predicted = answer[n, 0] + (answer[n, 3] * (square - answer[n, 2]) + base - answer[n, 1]) * answer[n, 4]
    low, high = max(predicted * (1.0 / LEAP), math.sqrt(base)), min(predicted * LEAP, q_node[-1])
    compliance = answer[n, 4]
    q = min(max(guess if guess > 0.0 else predicted + answer[n, 5], low), high)
    q_before = excess_before = 0.0
    for step in range(FEW_STEPS):
        if not low <= q <= high:
            return False
        _, per_a, z = divider(h, k_gap, bypass, leak, shift, q * q)
        gain = gain_of(flat, mass, mass_below, gap, q * q / p_scale, per_a / h_scale, z / h_scale, reach, out)
        excess = base + square * gain - q * q
        if step > 0 and excess != excess_before:
            compliance = (q_before - q) / (excess - excess_before)
        change = excess * compliance
        if abs(change) <= CLOSE * q and compliance > 0.0:
            q_new = q + change
            answer[n, 5] = q_new - predicted
            answer[n, 0], answer[n, 1], answer[n, 2] = q_new, base, square
            if square > 0.0:  # by the slope that belongs to the compliance, of which little is known in weak drives
                steepest = 2.0 * gain / q
                gain += min(max((2.0 * q - 1.0 / compliance) / square, -steepest), steepest) * change
            answer[n, 3], answer[n, 4] = gain, compliance
            answer[n, 6] = cell_of(q_node, q_new, int(answer[n, 6]), 0, q_node.size - 1)
            return True
        q_before, excess_before = q, excess
        q += change
    return False


@inlined
def guess_q(straight: float, base: float, square: float) -> float:
    """The q that belongs to a guess of 1/sqrt(gain); 0 if there is none."""
    q_square = base + square / (straight * straight)
    return math.sqrt(q_square) if q_square > 0.0 else 0.0
