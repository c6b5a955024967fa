"""Whole surfaces: the closed loop and the current at every combination of frequency, voltage and load.

At one frequency and voltage the pressure per mean square volt, the gain, depends on the total pressure p alone: a curve
of a few nodes (`gain_curves.py`), cubic between them in q = sqrt(p), over which it is as straight as over the
logarithm. On it <V^2>(p_e) = p_e/gain(p0 + p_e) is explicit; it is inverted for every voltage and load, the last
voltage's answer leading to the next one's.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from model.between import Between, between, fill_between
from model.chain import PreparedTouch
from model.compiled import inlined, kernel, span
from model.contact import area_ratio
from model.dielectrics import Array
from model.gain_curves import (
    KNOTS_AROUND,
    Family,
    GapSums,
    Integers,
    Nodes,
    Stack,
    choose_knots,
    fill_family,
    keep_shares,
    least_drive,
    make_family,
    make_gap_sums,
    mix,
    sum_gaps,
    travel,
    weigh_knots,
)
from model.gap_table import LOG_P_AXIS, GapTable
from model.pressure import MAX_ITERATIONS, TOLERANCE, first_gap

NODES_PER_ROW = 2  # of the table: pressures on a curve; of fourth order between them
FOLD_STEPS = 2  # per pressure of a curve, at which the slope is looked at for a turn of V(p_e)
BISECTIONS = 50
LEAP = 1.05  # in q: where the curve moves with the voltage, an answer this near the last one is on its branch
FEW_STEPS = 8  # in which Newton's method finds such an answer, if there is one

Spacing = tuple[float, ...]  # 4 x 5, see `_to_series`
Series = tuple[float, float, float, float, float]


class Search(NamedTuple):
    """Work arrays of the search for equilibria: curves at one voltage [j], fold and answer per load, see `_search`.

    `weights` are those of `weigh_knots`, `share` [j] is what a cap leaves of the gain. `stored` [k]: the answers at the
    voltages solved first, from which those after them start. `even` [v, 2n]: of each equilibrium 1/sqrt(gain), then one
    over its admittance, which change most evenly with the voltage.
    """

    weights: Array
    gain: Array
    current: Array
    share: Array
    end: Array
    end_gain: Array
    answer: Array
    stored: Array
    even: Array


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
    """Every frequency and voltage of `touch`, of shape (..., f, v) with voltage rising, under all of rising `load_pa`.

    For touches without bias and of one roughness; their own loads are ignored. Answers are [..., f, v, n].
    """
    circuit, rows = touch.circuit, (-1, touch.shape[-1])
    square, crest, added, limit, p_scale, shift = (
        x.reshape(rows)
        for x in (
            circuit.mean_square_v2, circuit.crest_square, circuit.added_pa, circuit.field_limit_v_per_m,
            circuit.pressure_scale_pa, circuit.gap_shift_m,
        )
    )  # fmt: skip
    h, k_gap, bypass, leak = (
        x.reshape(rows) for x in (circuit.h_m, circuit.k_gap, circuit.bypass_per_m, circuit.leak_per_m_pa)
    )
    stacks, h_scale = Stack(h, k_gap, bypass, leak, shift), circuit.length_scale_m[0]
    p_hat = np.exp(np.linspace(*LOG_P_AXIS[:2], (LOG_P_AXIS[2] - 1) * NODES_PER_ROW + 1))
    nodes = Nodes(
        p_hat, np.empty_like(p_hat), 1.0 - area_ratio(table.shape, p_hat), table.refined(NODES_PER_ROW), h_scale
    )
    least, most = added.min(axis=1), added.max(axis=1)
    place = travel(stacks, load_pa[0] + least, load_pa[-1] + most, h_scale)
    knots, counts = choose_knots(place)
    has_cap, most_knots = bool(np.isfinite(limit).any()), int(counts.max())
    shape = (*square.shape, load_pa.size)
    (pressure, admittance), pulled_in = np.empty((2, *shape)), np.zeros(shape, dtype=np.bool_)
    _solve_grid(
        stacks, nodes, make_family(most_knots, p_hat.size),
        make_gap_sums(table.mass, p_hat if has_cap else p_hat[:0], most_knots), place, knots, counts,
        _to_series(np.sqrt(p_hat)), between(touch.shape[-1]), square, square.max(axis=1),
        crest * np.abs(square) / limit**2, added, least, most, p_scale[:, 0], has_cap, load_pa, pressure, admittance,
        pulled_in,
    )  # fmt: skip
    whole = (*touch.shape, load_pa.size)
    return GridSolution(pressure.reshape(whole), admittance.reshape(whole), pulled_in.reshape(whole))


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
    spacing: Spacing, way: Between, square: Array, most_square: Array, crest_square: Array, added: Array, least: Array,
    most: Array, p_scale: Array, has_cap: bool, load: Array, pressure: Array, admittance: Array,
    pulled_in: NDArray[np.bool_],
) -> None:  # fmt: skip
    """Per frequency: its curves, some voltages under every load, the voltages between, and from gains to pressures.

    `crest_square` [f, v]: (peak voltage over the field's cap)^2, m^2; `least` and `most` [f] of the pressure `added`.
    """
    q_node, per_q, scale = np.empty(nodes.p.size), np.empty(nodes.p.size - 1), 0.0
    search = _make_search(q_node.size, way.solved.size, square.shape[1], load.size)
    even, rough = search.even, np.empty(square.shape[1], dtype=np.int64)
    missed = np.empty(way.miss.shape[0])
    for i in range(square.shape[0]):
        if p_scale[i] != scale:
            scale = p_scale[i]
            _lay_nodes(nodes, scale, q_node, per_q)
        first = _node_below(q_node, math.sqrt(load[0] + least[i]))
        last = fill_family(stacks, i, knots, counts[i], nodes, first, most_square[i], load[-1] + most[i], family)
        met, start = np.inf, 0
        if has_cap:
            x, y_square = family.x, family.y_square
            met = least_drive(x, y_square, family.openness, counts[i], first, last)
            start = first_gap(x[0, last], y_square[0, last])  # of the shortest length: pressure widens the leak
            for k in range(counts[i] if crest_square[i].max() > met else 0):
                sum_gaps(
                    x, y_square, sums.gap, sums.mass, sums.mass_below, sums.lost, sums.per_whole, sums.reach, k, first,
                    last, start,
                )  # fmt: skip
        voltages = way.solved
        for attempt in range(2):
            _solve_frequency(
                family, sums, search, place[i], knots[i], counts[i], q_node, per_q, spacing, first, last, voltages,
                way.number, square[i], crest_square[i], added[i], least[i], has_cap, met, start, load, pulled_in[i],
            )  # fmt: skip
            if attempt == 0:
                voltages = rough[: fill_between(way, even, missed, rough)]
        for v in range(square.shape[1]):
            for n in range(load.size):
                pressure[i, v, n] = square[i, v] / (even[v, n] * even[v, n])
                admittance[i, v, n] = 1.0 / even[v, load.size + n]


@kernel
def _lay_nodes(nodes: Nodes, p_scale: float, q_node: Array, per_q: Array) -> None:
    """Pressures of the curves and their roots q, and one over the distance to the next."""
    for j in range(q_node.size):
        nodes.p[j] = nodes.p_hat[j] * p_scale
        q_node[j] = math.sqrt(nodes.p[j])
    for j in range(per_q.size):
        per_q[j] = 1.0 / (q_node[j + 1] - q_node[j])


@kernel
def _solve_frequency(  # noqa: PLR0912, PLR0915 (one visible algorithm)
    family: Family, sums: GapSums, search: Search, place: Array, knots: Integers, count: int, q_node: Array,
    per_q: Array, spacing: Spacing, first: int, last: int, voltages: Integers, number: Integers, square: Array,
    crest_square: Array, added: Array, least: float, has_cap: bool, met: float, start: int, load: Array,
    pulled_in: NDArray[np.bool_],
) -> None:  # fmt: skip
    """<V^2>(p_e) = <V^2> at some `voltages` of one frequency, inverted by Newton's method within the rising part.

    `number` [v]: which of those solved first a voltage is, or -1. The cap is met where `crest_square` [v] is above
    `met`, in gaps from number `start` on.
    """
    weights, gain, current, share, end, end_gain, answer, stored, even = search
    straight, admittances, kept, x, y_square, openness = family  # numba counts references whenever a record's
    gap, mass, mass_below, lost, per_whole, reach = sums  # array is named: so not in the loops
    p_low, p_high = q_node[0] ** 2, q_node[-1] ** 2
    steady, was_capped = count == 1 and not has_cap, False
    for turn in range(voltages.size):
        v = voltages[turn]
        if v == 0:
            answer[:, 0] = -1.0
        elif number[v - 1] >= 0:
            answer[:] = stored[number[v - 1]]
        is_capped = has_cap and crest_square[v] > met
        low, high, fresh = first, last, turn > 0 and count == 1 and not is_capped and not was_capped
        was_capped = is_capped
        if not fresh and (is_capped or count > 1):
            low, high = _needed(answer, first, last)
        n, alone = 0, -1
        while n < load.size:
            if not fresh:
                near, end_of_near = weigh_knots(place, knots, count, v, weights)
                mix(admittances, weights, near, end_of_near, low, high, current)
                mix(straight, weights, near, end_of_near, low, high, gain)
                for j in span(low, high + 1):
                    gain[j] = 1.0 / (gain[j] * gain[j])
                if is_capped:
                    for k in range(near, end_of_near):
                        keep_shares(
                            x, y_square, openness, gap, mass, mass_below, lost, per_whole, reach, k, start,
                            crest_square[v], low, high, kept,
                        )  # fmt: skip
                    mix(kept, weights, near, end_of_near, low, high, share)
                    for j in span(low, high + 1):
                        gain[j] *= share[j]
                fresh = True
            base, before = load[n] + added[v], answer[n, 0]
            if alone != n:
                even[v, n] = even[v, load.size + n] = np.nan
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
            even[v, n] = 1.0 / math.sqrt(answer[n, 3])
            j = _stencil(int(answer[n, 6]), first, last)
            even[v, load.size + n] = 1.0 / _at(_series(spacing, current, j), (answer[n, 0] - q_node[j]) * per_q[j])[0]
            n += 1
        if number[v] >= 0:
            stored[number[v]] = answer


@kernel
def _make_search(pressures: int, stored: int, voltages: int, loads: int) -> Search:
    """Empty work arrays."""
    return Search(
        np.empty(KNOTS_AROUND), np.empty(pressures), np.empty(pressures), np.empty(pressures), np.empty(loads),
        np.empty(loads), np.empty((loads, 7)), np.empty((stored, loads, 7)), np.empty((voltages, 2 * loads)),
    )  # fmt: skip


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
