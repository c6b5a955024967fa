"""Electrostatic pressure and the closed loop that it forms with the contact.

p_e = (eps0/2) sum over drive branches of <V^2> K(p, z)/|a|^2, with p = p0 + p_e + p_added: pressure closes the gaps,
which raises the pressure. `solve` finds the lowest equilibrium of arbitrary conditions; `grid.py` those of a surface.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from model.compiled import kernel, kernel_of_sums
from model.dielectrics import EPS0, Array, ComplexArray
from model.gap_table import LOG_P_AXIS, LOG_U_AXIS, GapTable, gap_nodes, lookup, mass_at

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


def solve(table: GapTable, circuit: GapCircuit) -> Array:
    """Electrostatic pressure in Pa of each touch [n]; NaN where no equilibrium exists (pull-in)."""
    result = np.empty_like(circuit.load_pa)
    _solve(
        table.values, table.mass, gap_nodes(), circuit.pressure_scale_pa, circuit.length_scale_m, circuit.h_m,
        circuit.k_gap, circuit.bypass_per_m, circuit.leak_per_m_pa, circuit.mean_square_v2, circuit.crest_square,
        circuit.gap_shift_m, circuit.load_pa, circuit.added_pa, circuit.field_limit_v_per_m, result,
    )  # fmt: skip
    return result


@kernel
def _gain(
    values: Array, p_scale: float, h_scale: float, h: complex, k_gap: complex, beta: complex, shift: float,
    p: float, out: Array,
) -> float:  # fmt: skip
    """(eps0/2) K(p, z)/|a|^2: pressure per mean square volt at the total pressure p."""
    a = 1.0 + beta * h
    lookup(values, p / p_scale, (k_gap * h / a + shift) / h_scale, out)
    return float(0.5 * EPS0 * out[0] / (h_scale * abs(a)) ** 2)


@kernel_of_sums
def _kept_share(mass: Array, u: Array, p_hat: float, z_hat: complex, closest: float, at_p: Array) -> float:
    """Share of K^ that a cap on the local field leaves; `closest` is |u + z| at which the field meets it, per h_rms.

    `at_p` [u] is left holding P(u) du under this pressure.
    """
    row, weights = mass_at(p_hat)
    w0, w1, w2, w3 = weights
    for i in range(u.size):
        at_p[i] = w0 * mass[row, i] + w1 * mass[row + 1, i] + w2 * mass[row + 2, i] + w3 * mass[row + 3, i]
    closest_square = closest * closest
    kept = whole = 0.0
    reach = 0
    for i in range(u.size):
        square_distance = (u[i] + z_hat.real) ** 2 + z_hat.imag**2
        whole += at_p[i] / square_distance
        kept += at_p[i] / max(square_distance, closest_square)
        reach += square_distance < closest_square
    if 0 < reach < u.size:
        i = reach
        below, above = (u[i - 1] + z_hat.real) ** 2 + z_hat.imag**2, (u[i] + z_hat.real) ** 2 + z_hat.imag**2
        t = (closest_square - below) / (above - below)
        jumps = jump_of_slope(u[i - 1], at_p[i - 1], z_hat.real), jump_of_slope(u[i], at_p[i], z_hat.real)
        kept += edge_of_cap(t, jumps[0], jumps[1]) / (closest_square * closest_square)
    return kept / whole


@kernel
def edge_of_cap(t: float, jump_below: float, jump_above: float) -> float:
    """What the trapezoid rule in log u misses of the kink where the cap ends, times |u + z|^4 there.

    Euler-Maclaurin: h^2/2 B2(t) times the jump of the slope, t being the kink's place in its step h, between two
    neighbouring gaps with the given `jump_of_slope`. Without it the force is uneven by 1e-4 from gap to gap.
    """
    return -(t * (t - 1.0) + 1.0 / 6.0) * (jump_below + t * (jump_above - jump_below))


@kernel
def jump_of_slope(u: float, mass: float, z_real: float) -> float:
    """What `edge_of_cap` takes of the gap `u` with P(u) du = `mass`."""
    return LOG_U_AXIS[2] * mass * u * (u + z_real)


@kernel
def _solve(  # noqa: PLR0912 (one visible algorithm)
    values: Array, mass: Array, u: Array, p_scale: Array, h_scale: Array, h: ComplexArray, k_gap: ComplexArray,
    bypass: ComplexArray, leak: ComplexArray, mean_square: Array, crest: Array, shift: Array, load: Array, added: Array,
    field_limit: Array, result: Array,
) -> None:  # fmt: skip
    """Marching up from the unattracted contact in bounded steps, so that the lowest equilibrium is the one bracketed.

    The share of the drive that each pressure needs must rise on the way; where it turns back, the contact pulls in.
    """
    out, at_p = np.empty(3), np.empty(u.size)
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
                        gain *= _kept_share(mass, u, p / p_scale[i], z_hat, amplitude / field_limit[i], at_p)
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
