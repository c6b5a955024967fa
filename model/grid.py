"""Whole surfaces: the closed loop and the current at every combination of frequency, voltage and load.

At one frequency the pressure per mean square volt depends on the total pressure alone: a curve of a few nodes, cubic
between them. On it <V^2>(p_e) = p_e/gain(p0 + p_e) is explicit; it is inverted for every voltage and load, the last
voltage's answer leading to the next one's.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from model.chain import PreparedTouch
from model.compiled import kernel
from model.contact import area_ratio
from model.current import density_per_v
from model.dielectrics import EPS0, Array, ComplexArray
from model.gap_table import LOG_P_AXIS, GapTable, lookup
from model.pressure import MAX_ITERATIONS, TOLERANCE

NODES_PER_ROW = 2  # of the table: pressures on a curve; cubic between them
FOLD_STEPS = 2  # per pressure of a curve, at which the slope is looked at for a turn of V(p_e)
BISECTIONS = 50


@dataclass(frozen=True)
class GridSolution:
    """A solved surface [frequency, voltage, load].

    `electrostatic_pressure_pa` in Pa, NaN where there is no equilibrium in range; `admittance_per_m` is
    |current density/(j w eps0 V)|; `pulled_in` marks points past the fold of V(p_e), where the contact pulls in.
    """

    electrostatic_pressure_pa: Array
    admittance_per_m: Array
    pulled_in: NDArray[np.bool_]


def has_one_curve(touch: PreparedTouch) -> bool:
    """Whether nothing but the drive and the load change with the voltage of `touch`, of shape (f, v)."""
    c = touch.circuit
    same = (c.h_m, c.k_gap, c.bypass_per_m, c.leak_per_m_pa, c.gap_shift_m)
    by_frequency = (x.reshape(touch.shape) for x in same)
    return all(bool(np.all(x == x[:, :1])) for x in by_frequency) and bool(np.isinf(c.field_limit_v_per_m).all())


def solve_grid(table: GapTable, touch: PreparedTouch, load_pa: Array) -> GridSolution:
    """Every frequency and voltage of `touch`, of shape (f, v) with voltage rising, under every one of rising `load_pa`.

    For touches that `has_one_curve` is true of, without bias; their own loads are ignored.
    """
    circuit = touch.circuit
    square, added = (x.reshape(touch.shape) for x in (circuit.mean_square_v2, circuit.added_pa))

    def at_frequency(values: Any) -> Any:
        return np.ascontiguousarray(values.reshape(touch.shape)[:, 0])

    shape = (*touch.shape, load_pa.size)
    pressure, admittance, pulled_in = np.empty(shape), np.empty(shape), np.zeros(shape, dtype=np.bool_)
    p_hat = np.exp(np.linspace(*LOG_P_AXIS[:2], (LOG_P_AXIS[2] - 1) * NODES_PER_ROW + 1))
    _solve_grid(
        table.values, circuit.pressure_scale_pa[0], circuit.length_scale_m[0], p_hat * circuit.pressure_scale_pa[0],
        1.0 - area_ratio(table.shape, p_hat), at_frequency(circuit.h_m), at_frequency(circuit.k_gap),
        at_frequency(circuit.bypass_per_m), at_frequency(circuit.leak_per_m_pa), at_frequency(circuit.gap_shift_m),
        square, added, load_pa, pressure, admittance, pulled_in,
    )  # fmt: skip
    return GridSolution(pressure, admittance, pulled_in)


@kernel
def _solve_grid(
    values: Array, p_scale: float, h_scale: float, p_node: Array, apart: Array, h: ComplexArray, k_gap: ComplexArray,
    bypass: ComplexArray, leak: ComplexArray, shift: Array, square: Array, added: Array, load: Array,
    pressure: Array, admittance: Array, pulled_in: NDArray[np.bool_],
) -> None:  # fmt: skip
    """Per frequency: the curve, then <V^2>(p_e) = <V^2> inverted by Newton's method within the rising part."""
    log_gain, log_admittance = np.empty(p_node.size), np.empty(p_node.size)
    cubic, last_answer = np.empty((p_node.size, 8)), np.empty((load.size, 6))
    limit, limit_gain = np.empty(load.size), np.empty(load.size)
    step = math.log(p_node[1] / p_node[0])
    for i in range(square.shape[0]):
        least, most = np.min(added[i]), np.max(added[i])
        first = _node_below(p_node, load[0] + least)
        log_first = math.log(p_node[first])
        last = _fill_curve(
            values, p_scale, h_scale, p_node, apart, h[i], k_gap[i], bypass[i], leak[i], shift[i], np.max(square[i]),
            load[-1] + most, first, log_gain, log_admittance,
        )  # fmt: skip
        _fit_cubics(log_gain, log_admittance, first, last, cubic)
        for n in range(load.size):  # where the least pressure added does not fold, no greater one does
            limit[n], limit_gain[n] = _fold(cubic, p_node, step, load[n] + least, first, last)
        last_answer[:, 0] = -1.0
        for v in range(square.shape[1]):
            for n in range(load.size):
                base = load[n] + added[i, v]
                pressure[i, v, n] = admittance[i, v, n] = np.nan
                if not p_node[0] <= base < p_node[-1]:
                    continue
                highest, gain = limit[n], limit_gain[n]
                if highest < p_node[last] and added[i, v] > least:
                    highest, gain = _fold(cubic, p_node, step, base, first, last)
                if square[i, v] * gain > highest - base:
                    pulled_in[i, v, n] = highest < p_node[last]
                    continue
                pressure[i, v, n], admittance[i, v, n] = _invert(
                    cubic, log_first, 1.0 / step, first, last, base, square[i, v], highest, last_answer, n
                )


@kernel
def _node_below(p_node: Array, p: float) -> int:
    """First of the four nodes around the pressure `p`."""
    above = int(np.searchsorted(p_node, p, side="right"))
    return min(max(above - 2, 0), p_node.size - 4)


@kernel
def _fill_curve(
    values: Array, p_scale: float, h_scale: float, p_node: Array, apart: Array, h: complex, k_gap: complex,
    bypass: complex, leak: complex, shift: float, square: float, base: float, first: int,
    log_gain: Array, log_admittance: Array,
) -> int:  # fmt: skip
    """Logarithms of gain and admittance at the nodes from `first` to the returned one.

    That is two beyond the first that takes more than `square` under the highest load, or the table's end.
    """
    out = np.empty(3)
    last = p_node.size - 1
    for j in range(first, p_node.size):
        beta = bypass + leak * p_node[j]
        a = 1.0 + beta * h
        lookup(values, p_node[j] / p_scale, (k_gap * h / a + shift) / h_scale, out)
        gain = 0.5 * EPS0 * out[0] / (h_scale * abs(a)) ** 2
        log_gain[j] = np.log(gain)
        log_admittance[j] = np.log(density_per_v(beta, a, k_gap, apart[j], out, h_scale))
        if last == p_node.size - 1 and p_node[j] - base > square * gain:
            last = max(j + 2, first + 3)
        if j >= last:
            return j
    return p_node.size - 1


@kernel
def _fit_cubics(log_gain: Array, log_admittance: Array, first: int, last: int, cubic: Array) -> None:
    """Per cell between nodes [first..last], power series of both curves on its four nodes, from the first of them."""
    for cell in range(first, last):
        i = min(max(cell - 1, first), last - 3)
        for k, curve in enumerate((log_gain, log_admittance)):
            d1 = curve[i + 1] - curve[i]
            d2 = curve[i + 2] - 2.0 * curve[i + 1] + curve[i]
            d3 = curve[i + 3] - 3.0 * (curve[i + 2] - curve[i + 1]) - curve[i]
            cubic[cell, 4 * k] = curve[i]
            cubic[cell, 4 * k + 1] = d1 - d2 / 2.0 + d3 / 3.0
            cubic[cell, 4 * k + 2] = (d2 - d3) / 2.0
            cubic[cell, 4 * k + 3] = d3 / 6.0


@kernel
def _cell(log_first: float, per_log: float, first: int, last: int, p: float) -> tuple[int, float]:
    """Cell of the pressure `p`, and the place on its cubic; nodes lie 1/`per_log` apart in ln(p)."""
    x = (math.log(p) - log_first) * per_log + first
    cell = min(max(int(x), first), last - 1)
    return cell, x - min(max(cell - 1, first), last - 3)


@kernel
def _cubic(cubic: Array, cell: int, curve: int, t: float) -> tuple[float, float]:
    """One of the two curves and its slope per node, at the place `t` of a cell."""
    k = 4 * curve
    c1, c2, c3 = cubic[cell, k + 1], cubic[cell, k + 2], cubic[cell, k + 3]
    return cubic[cell, k] + t * (c1 + t * (c2 + t * c3)), c1 + t * (2.0 * c2 + t * 3.0 * c3)


@kernel
def _fold(cubic: Array, p_node: Array, step: float, base: float, first: int, last: int) -> tuple[float, float]:
    """Total pressure at which V(p_e) first turns back, and the gain there; the last pressure where it never does."""
    ratio, turn = math.exp(step / FOLD_STEPS), p_node[last]
    for cell in range(first, last):
        t = float(cell - min(max(cell - 1, first), last - 3))
        p = p_node[cell]
        for k in range(FOLD_STEPS):
            p *= ratio
            if p > base and _turned(cubic, cell, t + (k + 1) / FOLD_STEPS, step, p, base):
                low, high = max(p / ratio, base), p
                for _ in range(BISECTIONS):
                    turn = 0.5 * (low + high)
                    if _turned(cubic, cell, t + math.log(turn / p_node[cell]) / step, step, turn, base):
                        high = turn
                    else:
                        low = turn
                return low, math.exp(_cubic(cubic, cell, 0, t + math.log(low / p_node[cell]) / step)[0])
    return turn, math.exp(_cubic(cubic, last - 1, 0, 3.0)[0])  # its last cell's cubic begins three nodes before


@kernel
def _turned(cubic: Array, cell: int, t: float, step: float, p: float, base: float) -> bool:
    """Whether V(p_e) falls at the total pressure `p`: d ln(gain)/d ln(p) is over d ln(p - base)/d ln(p)."""
    return bool(_cubic(cubic, cell, 0, t)[1] * (p - base) > step * p)


@kernel
def _invert(
    cubic: Array, log_first: float, per_log: float, first: int, last: int, base: float, square: float, limit: float,
    last_answer: Array, n: int,
) -> tuple[float, float]:  # fmt: skip
    """Electrostatic pressure and admittance of the one equilibrium between `base` and `limit`.

    Newton's method from where the last voltage's answer leads along its slope, with what that had missed before.
    `last_answer` [n]: total pressure (negative for none), base, mean square, gain, compliance, and that miss.
    """
    low, high, predicted, missed = base, limit, base, 0.0
    if last_answer[n, 0] >= 0.0:
        missed = last_answer[n, 5]
        moved = last_answer[n, 3] * (square - last_answer[n, 2]) + base - last_answer[n, 1]
        predicted = last_answer[n, 0] + moved * last_answer[n, 4]
    p = predicted + missed
    if not low <= p <= high:
        p = low
    gain = compliance = slope = change = t = per_p = 0.0
    cell = 0
    for _ in range(MAX_ITERATIONS):
        cell, t = _cell(log_first, per_log, first, last, p)
        log_gain, slope = _cubic(cubic, cell, 0, t)
        gain, per_p = math.exp(log_gain), per_log / p
        slope *= gain * per_p
        excess = base + square * gain - p
        compliance = 1.0 / (1.0 - square * slope)
        change = excess * compliance
        if change * change <= TOLERANCE * p * p:
            break  # what Newton's method leaves is of the order of its last step's square
        change = 0.0
        if abs(excess) <= TOLERANCE * p:
            break
        if excess > 0.0:
            low = p
        else:
            high = p
        p += excess * compliance
        if not low < p < high:
            p = 0.5 * (low + high)
    gain += slope * change
    last_answer[n, 5] = p + change - predicted if last_answer[n, 0] >= 0.0 else 0.0
    last_answer[n, 0], last_answer[n, 1], last_answer[n, 2] = p + change, base, square
    last_answer[n, 3], last_answer[n, 4] = gain, compliance
    return square * gain, math.exp(_cubic(cubic, cell, 1, t + change * per_p)[0])
