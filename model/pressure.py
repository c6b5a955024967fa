"""Electrostatic pressure and the closed loop that it forms with the contact.

p_e = (eps0/2) sum over drive components of <V^2> K(p, z)/|a|^2, with p = p0 + p_e: pressure closes the gaps, which
raises the pressure. For one component V(p_e) is explicit; `solve` finds the lowest equilibrium of arbitrary conditions,
`solve_grid` those of a whole surface by inverting V(p_e) frequency by frequency.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from model.compiled import kernel
from model.dielectrics import EPS0, Array, ComplexArray
from model.gap_table import LOG_P_AXIS, GapTable, lookup
from model.layers import Stack

PRESSURE_NODES = 128  # per frequency of a surface; cubic between them
TOLERANCE = 1e-10
MAX_ITERATIONS = 200
MOST_GROWTH = 1.15  # of the pressure per step while no equilibrium has been bracketed


@dataclass(frozen=True)
class ContactScales:
    """The finger's scales of pressure and of length: Y* q0 h_rms (Pa) and h_rms (m)."""

    pressure_pa: float
    length_m: float


@dataclass(frozen=True)
class GridSolution:
    """A solved surface: pressure [frequency, voltage, load] in Pa, NaN where there is no equilibrium in range.

    `pull_in_voltage_v` [frequency, load] is the voltage at which V(p_e) turns back, infinite where it never does.
    """

    electrostatic_pressure_pa: Array
    pull_in_voltage_v: Array


def solve(table: GapTable, scales: ContactScales, components: list[tuple[Stack, Array]], load_pa: Array) -> Array:
    """Electrostatic pressure in Pa of each condition [n]; NaN where no equilibrium exists (pull-in).

    `components`: each a stack over the n conditions and the mean square voltage [n] in V^2 driven through it (V^2/2
    for a sine of amplitude V); a biased drive has two. `load_pa` [n]: normal force over apparent area.
    """
    h = np.stack([s.h_m for s, _ in components], axis=1)
    k_gap = np.stack([s.k_gap for s, _ in components], axis=1)
    leak = np.stack([s.leak_per_m_pa for s, _ in components], axis=1)
    mean_square = np.stack([v for _, v in components], axis=1)
    result = np.empty_like(load_pa)
    _solve(table.values, scales.pressure_pa, scales.length_m, h, k_gap, leak, mean_square, load_pa, result)
    return result


def solve_grid(table: GapTable, scales: ContactScales, sine: Stack, voltage_v: Array, load_pa: Array) -> GridSolution:
    """Every combination of frequency (of `sine`), rising `voltage_v` (amplitude) and rising `load_pa`."""
    shape = (sine.omega.size, voltage_v.size, load_pa.size)
    pressure = np.empty(shape)
    pull_in = np.empty((shape[0], shape[2]))
    log_p = np.linspace(np.log(load_pa[0]), LOG_P_AXIS[1] + np.log(scales.pressure_pa), PRESSURE_NODES)
    _solve_grid(
        table.values, scales.pressure_pa, scales.length_m, sine.h_m, sine.k_gap, sine.leak_per_m_pa,
        log_p, voltage_v, load_pa, pressure, pull_in,
    )  # fmt: skip
    return GridSolution(pressure, pull_in)


@kernel
def _gain(
    values: Array, p_scale: float, h_scale: float, h: complex, k_gap: complex, leak: complex, p: float, out: Array
) -> float:
    """(eps0/2) K(p, z)/|a|^2: pressure per mean square volt at the total pressure p."""
    a = 1.0 + leak * p * h
    lookup(values, p / p_scale, k_gap * h / a / h_scale, out)
    return float(0.5 * EPS0 * out[0] / (h_scale * abs(a)) ** 2)


@kernel
def _solve(  # noqa: PLR0912 (one visible algorithm)
    values: Array, p_scale: float, h_scale: float, h: ComplexArray, k_gap: ComplexArray, leak: ComplexArray,
    mean_square: Array, load: Array, result: Array,
) -> None:  # fmt: skip
    """Marching up from the unattracted contact in bounded steps, so that the lowest equilibrium is the one bracketed.

    The share of the drive that each pressure needs must rise on the way; where it turns back, the contact pulls in.
    """
    out = np.empty(3)
    for i in range(load.size):
        base = load[i]
        p_min, p_max = p_scale * np.exp(LOG_P_AXIS[0]), p_scale * np.exp(LOG_P_AXIS[1])
        p, previous, below, above = base, base, base, np.inf
        excess_previous, share_previous, solution = 0.0, 0.0, np.nan
        for iteration in range(MAX_ITERATIONS):
            if not p_min <= p <= p_max:
                break  # outside every pressure of the table
            attraction = 0.0
            for c in range(mean_square.shape[1]):
                if mean_square[i, c] > 0.0:
                    attraction += mean_square[i, c] * _gain(
                        values, p_scale, h_scale, h[i, c], k_gap[i, c], leak[i, c], p, out
                    )
            excess = base + attraction - p
            if abs(excess) <= TOLERANCE * p:
                solution = attraction
                break
            if excess > 0.0:
                if above == np.inf and (p - base) < share_previous * attraction:
                    break  # V(p_e) has turned back below this drive: pulled in
                below, share_previous = p, (p - base) / attraction
            else:
                above = p
            step = p + excess  # a fixed-point step from below never passes the lowest equilibrium
            if iteration > 0 and excess != excess_previous:
                secant = p - excess * (p - previous) / (excess - excess_previous)
                if below < secant < above:
                    step = secant
            if above == np.inf:
                step = min(max(step, (1.0 + 1e-12) * p), MOST_GROWTH * p)
            elif not below < step < above:
                step = 0.5 * (below + above)
            previous, excess_previous = p, excess
            p = step
        result[i] = solution


@kernel
def _solve_grid(
    values: Array, p_scale: float, h_scale: float, h: ComplexArray, k_gap: ComplexArray, leak: ComplexArray,
    log_p: Array, voltage: Array, load: Array, result: Array, pull_in: Array,
) -> None:  # fmt: skip
    """Per frequency: ln(p_e/V^2) on pressure nodes, then V(p_e) = V inverted for every voltage and load."""
    out, log_gain = np.empty(3), np.empty(log_p.size)
    p_min, p_max = p_scale * np.exp(LOG_P_AXIS[0]), p_scale * np.exp(LOG_P_AXIS[1])
    step = log_p[1] - log_p[0]
    for i in range(h.size):
        for j in range(log_p.size):
            gain = _gain(values, p_scale, h_scale, h[i], k_gap[i], leak[i], np.exp(log_p[j]), out)
            log_gain[j] = np.log(0.5 * gain)  # a sine of amplitude V has the mean square V^2/2
        for n in range(load.size):
            if not p_min <= load[n] < p_max:
                pull_in[i, n] = np.inf
                result[i, :, n] = np.nan
                continue
            limit = _monotone_limit(log_p, log_gain, load[n])
            highest = np.sqrt((limit - load[n]) / _gain_at(log_p[0], step, log_gain, limit)[0])
            pull_in[i, n] = highest if limit < np.exp(log_p[-1]) else np.inf
            p = load[n]
            for v in range(voltage.size):
                square = voltage[v] * voltage[v]
                if voltage[v] > highest:
                    result[i, v, n] = np.nan
                    continue
                low, high = p, limit
                for _ in range(MAX_ITERATIONS):
                    gain, slope = _gain_at(log_p[0], step, log_gain, p)
                    excess = load[n] + square * gain - p
                    if abs(excess) <= TOLERANCE * p:
                        break
                    if excess > 0.0:
                        low = p
                    else:
                        high = p
                    p -= excess / (square * gain * slope / p - 1.0)
                    if not low < p < high:
                        p = 0.5 * (low + high)
                result[i, v, n] = square * _gain_at(log_p[0], step, log_gain, p)[0]


@kernel
def _monotone_limit(log_p: Array, log_gain: Array, load: float) -> float:
    """The total pressure up to which V(p_e) rises from node to node; the last node when it never turns."""
    last = 0.0
    for j in range(log_p.size):
        p = np.exp(log_p[j])
        if p <= load:
            continue
        square = np.log(p - load) - log_gain[j]
        if last != 0.0 and square <= last:
            return math.exp(log_p[j - 1])
        last = square
    return math.exp(log_p[-1])


@kernel
def _gain_at(first: float, step: float, log_gain: Array, p: float) -> tuple[float, float]:
    """Gain at the pressure p and d ln(gain)/d ln(p), cubic on four nodes."""
    position = (np.log(p) - first) / step
    i = min(max(int(position) - 1, 0), log_gain.size - 4)
    t = position - i
    t1, t2, t3 = t - 1.0, t - 2.0, t - 3.0
    a, b, c, d = log_gain[i], log_gain[i + 1], log_gain[i + 2], log_gain[i + 3]
    value = -t1 * t2 * t3 * a / 6.0 + t * t2 * t3 * b / 2.0 - t * t1 * t3 * c / 2.0 + t * t1 * t2 * d / 6.0
    slope = (
        -(t2 * t3 + t1 * t3 + t1 * t2) * a / 6.0
        + (t2 * t3 + t * t3 + t * t2) * b / 2.0
        - (t1 * t3 + t * t3 + t * t1) * c / 2.0
        + (t1 * t2 + t * t2 + t * t1) * d / 6.0
    )
    return math.exp(value), slope / step
