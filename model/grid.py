"""Whole surfaces: the closed loop and the current at every combination of frequency, voltage and load.

At one frequency and voltage the pressure per mean square volt, the gain, depends on the total pressure p alone: a curve
of a few nodes (`gain_curves.py`), cubic between them in q = sqrt(p), over which it is as straight as over the
logarithm. On it <V^2>(p_e) = p_e/gain(p0 + p_e) is explicit; it is inverted for every voltage and load, the last
voltage's answer leading to the next one's.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from model.chain import PreparedTouch
from model.compiled import inlined, kernel
from model.contact import area_ratio
from model.dielectrics import Array
from model.gain_curves import (
    Family,
    GapSums,
    Integers,
    Nodes,
    Stack,
    blend,
    cap_gains,
    choose_knots,
    copy_curve,
    fill_family,
    first_gap,
    make_family,
    make_gap_sums,
    start_caps,
    straighten,
    travel,
)
from model.gap_table import LOG_P_AXIS, GapTable
from model.pressure import MAX_ITERATIONS, TOLERANCE

NODES_PER_ROW = 2  # of the table: pressures on a curve; of fourth order between them
FOLD_STEPS = 2  # per pressure of a curve, at which the slope is looked at for a turn of V(p_e)
BISECTIONS = 50
LEAP = 1.05  # in q: where the curve moves with the voltage, an answer this near the last one is on its branch
FEW_STEPS = 8  # in which Newton's method finds such an answer, if there is one

Spacing = tuple[float, ...]  # 4 x 5, see `_to_series`
Series = tuple[float, float, float, float, float]


@dataclass(frozen=True)
class GridSolution:
    """A solved surface [frequency, voltage, load].

    `electrostatic_pressure_pa` in Pa, NaN where there is no equilibrium in range; `admittance_per_m` is
    |current density/(j w eps0 V)|; `pulled_in` marks points past the fold of V(p_e), where the contact pulls in.
    """

    electrostatic_pressure_pa: Array
    admittance_per_m: Array
    pulled_in: NDArray[np.bool_]


def solve_grid(table: GapTable, touch: PreparedTouch, load_pa: Array) -> GridSolution:
    """Every frequency and voltage of `touch`, of shape (f, v) with voltage rising, under every one of rising `load_pa`.

    For touches without bias; their own loads are ignored.
    """
    circuit = touch.circuit
    square, crest, added, limit = (
        x.reshape(touch.shape)
        for x in (circuit.mean_square_v2, circuit.crest_square, circuit.added_pa, circuit.field_limit_v_per_m)
    )
    h, k_gap, bypass, leak = (
        x.reshape(touch.shape) for x in (circuit.h_m, circuit.k_gap, circuit.bypass_per_m, circuit.leak_per_m_pa)
    )
    stacks = Stack(h, k_gap, bypass, leak, circuit.gap_shift_m.reshape(touch.shape))
    p_hat = np.exp(np.linspace(*LOG_P_AXIS[:2], (LOG_P_AXIS[2] - 1) * NODES_PER_ROW + 1))
    p_scale, h_scale = circuit.pressure_scale_pa[0], circuit.length_scale_m[0]
    nodes = Nodes(p_hat * p_scale, 1.0 - area_ratio(table.shape, p_hat), table.values, p_scale, h_scale)
    least, most = added.min(axis=1), added.max(axis=1)
    place = travel(stacks, load_pa[0] + least, load_pa[-1] + most, h_scale)
    knots, counts = choose_knots(place)
    has_cap, most_knots = bool(np.isfinite(limit).any()), int(counts.max())
    shape = (*touch.shape, load_pa.size)
    (pressure, admittance), pulled_in = np.empty((2, *shape)), np.zeros(shape, dtype=np.bool_)
    q_node = np.sqrt(nodes.p)
    _solve_grid(
        stacks, nodes, make_family(most_knots, p_hat.size),
        make_gap_sums(table.mass, p_hat if has_cap else p_hat[:0], most_knots), place, knots, counts, q_node,
        1.0 / np.diff(q_node), _to_series(q_node), square, square.max(axis=1), crest * np.abs(square) / limit**2,
        added, least, most, has_cap, load_pa, pressure, admittance, pulled_in,
    )  # fmt: skip
    return GridSolution(pressure, admittance, pulled_in)


def _to_series(q_node: Array) -> Spacing:
    """How the values at five nodes make a power series from the first, the distance to the second being 1.

    The same around every node, for they lie evenly in the logarithm.
    """
    q = q_node[:5]
    rows = np.linalg.inv(np.vander((q - q[0]) / (q[1] - q[0]), increasing=True))
    return tuple(rows[1:].ravel().tolist())


@kernel
def _solve_grid(
    stacks: Stack, nodes: Nodes, family: Family, sums: GapSums, place: Array, knots: Integers, counts: Integers,
    q_node: Array, per_q: Array, spacing: Spacing, square: Array, most_square: Array, crest_square: Array, added: Array,
    least: Array, most: Array, has_cap: bool, load: Array, pressure: Array, admittance: Array,
    pulled_in: NDArray[np.bool_],
) -> None:  # fmt: skip
    """Per frequency: its curves, then every voltage and load on them.

    `crest_square` [f, v]: (peak voltage over the field's cap)^2, m^2; `least` and `most` [f] of the pressure `added`.
    """
    for i in range(square.shape[0]):
        first = _node_below(q_node, math.sqrt(load[0] + least[i]))
        last = fill_family(stacks, i, knots, counts[i], nodes, first, most_square[i], load[-1] + most[i], family)
        met, start = np.inf, 0
        if has_cap:
            met = start_caps(family.z, family.openness, counts[i], first, last, sums.per_whole, sums.step)
            start = first_gap(family.z[0, last])  # the shortest: pressure widens the leak
        _solve_frequency(
            family, sums, place[i], knots[i], counts[i], q_node, per_q, spacing, first, last, square[i],
            crest_square[i], added[i], least[i], has_cap, met, start, load, pressure[i], admittance[i], pulled_in[i],
        )  # fmt: skip


@kernel
def _solve_frequency(  # noqa: PLR0912, PLR0915 (one visible algorithm)
    family: Family, sums: GapSums, place: Array, knots: Integers, count: int, q_node: Array, per_q: Array,
    spacing: Spacing, first: int, last: int, square: Array, crest_square: Array, added: Array, least: float,
    has_cap: bool, met: float, start: int, load: Array, pressure: Array, admittance: Array,
    pulled_in: NDArray[np.bool_],
) -> None:  # fmt: skip
    """<V^2>(p_e) = <V^2> at one frequency, inverted by Newton's method within the rising part.

    The cap is met where `crest_square` [v] is above `met`, in gaps from number `start` on.
    """
    gain, current = np.empty(q_node.size), np.empty(q_node.size)
    end, end_gain, answer = np.empty(load.size), np.empty(load.size), np.empty((load.size, 7))
    gains, admittances, straight, capped, lengths, openness = family  # numba counts references whenever a record's
    gap, mass, mass_below, per_whole, reach, lost, step = sums  # array is named: so not in the loops
    p_low, p_high = q_node[0] ** 2, q_node[-1] ** 2
    steady, was_capped = count == 1 and not has_cap, False
    answer[:, 0] = -1.0
    if count == 1:
        copy_curve(admittances, first, last, current)
    for v in range(square.size):
        is_capped = has_cap and (crest_square[v] > met or count > 1)
        low, high, fresh = first, last, v > 0 and count == 1 and not is_capped and not was_capped
        was_capped = is_capped
        if not fresh and (is_capped or count > 1):
            low, high = _needed(answer, first, last)
        n, alone = 0, -1
        while n < load.size:
            if not fresh:
                if is_capped:
                    for k in range(count):
                        cap_gains(
                            gains, lengths, openness, mass, mass_below, gap, per_whole, reach, lost, step, k, start,
                            crest_square[v], low, high, capped,
                        )  # fmt: skip
                    if count > 1:
                        straighten(capped, count, low, high, straight)
                if count > 1:
                    blend(place, knots, count, v, low, high, straight, admittances, gain, current)
                else:
                    copy_curve(capped if is_capped else gains, low, high, gain)
                fresh = True
            base, before = load[n] + added[v], answer[n, 0]
            if alone != n:
                pressure[v, n] = admittance[v, n] = np.nan
            if not p_low <= base < p_high:
                n += 1
                continue
            q_low = math.sqrt(base)
            follows = not steady and before > 0.0 and alone != n
            if follows:  # the curve has moved: an answer near the last one is on its branch
                q_low, q_high, steps = max(before * (1.0 / LEAP), q_low), min(before * LEAP, q_node[last]), FEW_STEPS
            else:
                if steady and v == 0:  # where the least pressure added does not fold, no greater one does
                    end[n], end_gain[n] = _fold(gain, q_node, per_q, spacing, first, last, load[n] + least)
                q_high, gain_there, steps = end[n], end_gain[n], MAX_ITERATIONS
                if not steady or (q_high < q_node[last] and added[v] > least):
                    q_high, gain_there = _fold(gain, q_node, per_q, spacing, first, last, base)
                if square[v] * gain_there > q_high * q_high - base:
                    pulled_in[v, n] = q_high < q_node[last]
                    answer[n, 0] = -1.0
                    n += 1
                    continue
            found = _search(
                gain, q_node, per_q, spacing, first, last, low, high, base, square[v], q_low, q_high, steps, answer, n
            )
            if follows and not found:  # once more, below the fold of the whole curve
                alone, fresh = n, low == first and high == last
                low, high = first, last
                continue
            pressure[v, n] = square[v] * answer[n, 3]
            j = _stencil(int(answer[n, 6]), first, last)
            admittance[v, n] = _at(_series(spacing, current, j), (answer[n, 0] - q_node[j]) * per_q[j])[0]
            n += 1


@kernel
def _needed(answer: Array, first: int, last: int) -> tuple[int, int]:
    """Nodes that a search of every load should need, which ends in the last answer's cell or one beside it."""
    low, high = last, first
    for n in range(answer.shape[0]):
        if answer[n, 0] < 0.0:
            return first, last
        low, high = min(low, int(answer[n, 6])), max(high, int(answer[n, 6]))
    return _stencil(max(low - 1, first), first, last), _stencil(min(high + 1, last - 1), first, last) + 4


@kernel
def _node_below(q_node: Array, q: float) -> int:
    """First of the five nodes around the place `q`."""
    above = 0
    while above < q_node.size and q_node[above] <= q:
        above += 1
    return min(max(above - 2, 0), q_node.size - 5)


@kernel
def _stencil(cell: int, first: int, last: int) -> int:
    """First of the five nodes around a cell."""
    return min(max(cell - 1, first), last - 4)


@kernel
def _series(spacing: Spacing, y: Array, i: int) -> Series:
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
def _at(series: Series, t: float) -> tuple[float, float]:
    """Value and slope of a power series at the place `t`."""
    c0, c1, c2, c3, c4 = series
    return (
        c0 + t * (c1 + t * (c2 + t * (c3 + t * c4))),
        c1 + t * (2.0 * c2 + t * (3.0 * c3 + t * 4.0 * c4)),
    )


@kernel
def _fold(
    gain: Array, q_node: Array, per_q: Array, spacing: Spacing, first: int, last: int, base: float
) -> tuple[float, float]:
    """q at which V(p_e) first turns back, and the gain there; that of the last node where it never does."""
    for cell in range(first, last):
        i = _stencil(cell, first, last)
        series = _series(spacing, gain, i)
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
                return low, _at(series, (low - q_node[i]) * per_q[i])[0]
    return q_node[last], gain[last]


@kernel
def _turned(series: Series, start: float, per_q: float, q: float, base: float) -> bool:
    """Whether V(p_e) falls at q: d ln(gain) is over d ln(p - base)."""
    gain, slope = _at(series, (q - start) * per_q)
    return slope * per_q * (q * q - base) > 2.0 * q * gain


@inlined
def _search(
    gain: Array, q_node: Array, per_q: Array, spacing: Spacing, first: int, last: int, from_node: int, to_node: int,
    base: float, square: float, low: float, high: float, steps: int, answer: Array, n: int,
) -> bool:  # fmt: skip
    """The equilibrium between `low` and `high`, in q; False, and `answer` as it was, where Newton's method finds none.

    The curve is known from `from_node` to `to_node`; an answer elsewhere is none. The search
    starts where the last voltage's answer leads along its slope, with what that had missed before. `answer` [n]: q
    (negative for none), base, mean square, gain, compliance dq/dp, that miss, and the cell of the curve.
    """
    predicted, missed, cell = low, 0.0, first
    if answer[n, 0] > 0.0:
        missed, cell = answer[n, 5], min(int(answer[n, 6]), last - 1)
        predicted = answer[n, 0] + (answer[n, 3] * (square - answer[n, 2]) + base - answer[n, 1]) * answer[n, 4]
    q = predicted + missed
    if not low <= q <= high:
        q = low
    for _ in range(steps):
        while cell < last - 1 and q > q_node[cell + 1]:
            cell += 1
        while cell > first and q < q_node[cell]:
            cell -= 1
        i = _stencil(cell, first, last)
        if i < from_node or i + 4 > to_node:
            return False
        value, slope = _at(_series(spacing, gain, i), (q - q_node[i]) * per_q[i])
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
