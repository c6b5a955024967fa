"""Electrostatic pressure and the closed loop that it forms with the contact.

p_e = (eps0/2) sum over drive branches of <V^2> K(p, z)/|a|^2, with p = p0 + p_e + p_added: pressure closes the gaps,
which raises the pressure. For one branch V(p_e) is explicit; `solve` finds the lowest equilibrium of arbitrary
conditions, `solve_grid` those of a whole surface by inverting V(p_e) frequency by frequency.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

import numpy as np

from model.compiled import kernel
from model.dielectrics import EPS0, Array, ComplexArray
from model.gap_table import LOG_P_AXIS, GapTable, gap_nodes, lookup, mass_at

PRESSURE_NODES = 128  # per frequency of a surface; cubic between them
TOLERANCE = 1e-10
MAX_ITERATIONS = 200
MOST_GROWTH = 1.15  # of the pressure per step while no equilibrium has been bracketed


@dataclass(frozen=True)
class GapCircuit:
    """Touches [n] as the closed loop sees them, each with `c` branches; everything already broadcast.

    `pressure_scale_pa` Y* q0 h_rms and `length_scale_m` h_rms [n]; per branch [n, c] the complex length `h_m`, `k_gap`,
    the admittance beside the gap over j w eps0, as `bypass_per_m` + `leak_per_m_pa` p, `mean_square_v2` and its
    `crest_square` (peak over mean square); `gap_shift_m`, `load_pa` (normal force over area), `added_pa` (other
    attraction) and `field_limit_v_per_m` [n].
    """

    pressure_scale_pa: Array
    length_scale_m: Array
    h_m: ComplexArray
    k_gap: ComplexArray
    bypass_per_m: ComplexArray
    leak_per_m_pa: ComplexArray
    mean_square_v2: Array
    crest_square: Array
    gap_shift_m: Array
    load_pa: Array
    added_pa: Array
    field_limit_v_per_m: Array

    def repeated(self, times: int) -> GapCircuit:
        """Every touch `times` in a row."""
        return GapCircuit(**{f.name: np.repeat(getattr(self, f.name), times, axis=0) for f in fields(self)})


@dataclass(frozen=True)
class GridSolution:
    """A solved surface: pressure [frequency, voltage, load] in Pa, NaN where there is no equilibrium in range.

    `pull_in_voltage_v` [frequency, load] is the voltage at which V(p_e) turns back, infinite where it never does.
    """

    electrostatic_pressure_pa: Array
    pull_in_voltage_v: Array


def solve(table: GapTable, circuit: GapCircuit) -> Array:
    """Electrostatic pressure in Pa of each touch [n]; NaN where no equilibrium exists (pull-in)."""
    result = np.empty_like(circuit.load_pa)
    _solve(
        table.values, table.mass, gap_nodes(), circuit.pressure_scale_pa, circuit.length_scale_m, circuit.h_m,
        circuit.k_gap, circuit.bypass_per_m, circuit.leak_per_m_pa, circuit.mean_square_v2, circuit.crest_square,
        circuit.gap_shift_m, circuit.load_pa, circuit.added_pa, circuit.field_limit_v_per_m, result,
    )  # fmt: skip
    return result


def solve_grid(table: GapTable, sine: GapCircuit, voltage_v: Array, load_pa: Array) -> GridSolution:
    """Every combination of frequency (the rows of `sine`), rising `voltage_v` (amplitude) and rising `load_pa`.

    For circuits whose branches do not depend on voltage or load, without shift, added pressure or field limit.
    """
    shape = (sine.load_pa.size, voltage_v.size, load_pa.size)
    pressure = np.empty(shape)
    pull_in = np.empty((shape[0], shape[2]))
    highest = LOG_P_AXIS[1] + np.log(sine.pressure_scale_pa[0])
    log_p = np.linspace(np.log(load_pa[0]), highest, PRESSURE_NODES)
    _solve_grid(
        table.values, sine.pressure_scale_pa[0], sine.length_scale_m[0], sine.h_m[:, 0], sine.k_gap[:, 0],
        sine.leak_per_m_pa[:, 0], log_p, voltage_v, load_pa, pressure, pull_in,
    )  # fmt: skip
    return GridSolution(pressure, pull_in)


@kernel
def _gain(
    values: Array, p_scale: float, h_scale: float, h: complex, k_gap: complex, beta: complex, shift: float,
    p: float, out: Array,
) -> float:  # fmt: skip
    """(eps0/2) K(p, z)/|a|^2: pressure per mean square volt at the total pressure p."""
    a = 1.0 + beta * h
    lookup(values, p / p_scale, (k_gap * h / a + shift) / h_scale, out)
    return float(0.5 * EPS0 * out[0] / (h_scale * abs(a)) ** 2)


@kernel
def _beyond_limit(mass: Array, u: Array, p_hat: float, z_hat: complex, amplitude: float, limit: float) -> float:
    """Share of K^ that a cap on the local field takes away; `amplitude` is the field times |u + z|, per h_rms."""
    row, weights = mass_at(p_hat)
    closest = amplitude / limit  # |u + z| at which the field meets the cap
    lost = whole = 0.0
    for i in range(u.size):
        m = 0.0
        for b in range(4):
            m += weights[b] * mass[row + b, i]
        square = (u[i] + z_hat.real) ** 2 + z_hat.imag**2
        whole += m / square
        if square < closest * closest:
            lost += m * (1.0 / square - 1.0 / (closest * closest))
    return lost / whole


@kernel
def _solve(  # noqa: PLR0912 (one visible algorithm)
    values: Array, mass: Array, u: Array, p_scale: Array, h_scale: Array, h: ComplexArray, k_gap: ComplexArray,
    bypass: ComplexArray, leak: ComplexArray, mean_square: Array, crest: Array, shift: Array, load: Array, added: Array,
    field_limit: Array, result: Array,
) -> None:  # fmt: skip
    """Marching up from the unattracted contact in bounded steps, so that the lowest equilibrium is the one bracketed.

    The share of the drive that each pressure needs must rise on the way; where it turns back, the contact pulls in.
    """
    out = np.empty(3)
    for i in range(load.size):
        base = load[i] + added[i]
        p_min, p_max = p_scale[i] * np.exp(LOG_P_AXIS[0]), p_scale[i] * np.exp(LOG_P_AXIS[1])
        p, previous, below, above = base, base, base, np.inf
        excess_previous, share_previous, solution = 0.0, 0.0, np.nan
        for iteration in range(MAX_ITERATIONS):
            if not p_min <= p <= p_max:
                break  # outside every pressure of the table
            attraction = 0.0
            for c in range(mean_square.shape[1]):
                if mean_square[i, c] != 0.0:
                    beta = bypass[i, c] + leak[i, c] * p
                    gain = _gain(values, p_scale[i], h_scale[i], h[i, c], k_gap[i, c], beta, shift[i], p, out)
                    if field_limit[i] < np.inf:
                        a = 1.0 + beta * h[i, c]
                        z_hat = (k_gap[i, c] * h[i, c] / a + shift[i]) / h_scale[i]
                        amplitude = np.sqrt(crest[i, c] * abs(mean_square[i, c])) / (abs(a) * h_scale[i])
                        gain *= 1.0 - _beyond_limit(mass, u, p / p_scale[i], z_hat, amplitude, field_limit[i])
                    attraction += mean_square[i, c] * gain
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
            gain = _gain(
                values, p_scale, h_scale, h[i], k_gap[i], leak[i] * np.exp(log_p[j]), 0.0, np.exp(log_p[j]), out
            )
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
