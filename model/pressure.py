"""Electrostatic pressure and the closed loop that it forms with the contact.

p_e = (eps0/2) sum over drive branches of <V^2> K(p, z)/|a|^2, with p = p0 + p_e + p_added: pressure closes the gaps,
which raises the pressure. `solve` finds the lowest equilibrium of arbitrary conditions; `grid.py` those of a surface.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from model.compiled import inlined, kernel, kernel_of_sums, span
from model.dielectrics import EPS0, Array, ComplexArray
from model.gap_table import (
    LOG_P_AXIS,
    LOG_U_AXIS,
    LOOKED_UP,
    Four,
    GapTable,
    gap_nodes,
    length_of,
    lookup_between,
    row_of,
)

TOLERANCE = 1e-10
MAX_ITERATIONS = 200
MOST_GROWTH = 1.15  # of the pressure per step while no equilibrium has been bracketed
# of the stack's length: in narrower gaps the field is that of none, and they carry about 1 % of K^
LOG_NARROW = math.log(1e-4)


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
        table.flat, table.mass, table.mass_below, gap_nodes(), circuit.pressure_scale_pa, circuit.length_scale_m,
        circuit.h_m, circuit.k_gap, circuit.bypass_per_m, circuit.leak_per_m_pa, circuit.mean_square_v2,
        circuit.crest_square, circuit.gap_shift_m, circuit.load_pa, circuit.added_pa, circuit.field_limit_v_per_m,
        result,
    )  # fmt: skip
    return result


@kernel
def divider(
    h: complex, k_gap: complex, bypass: complex, leak: complex, shift: float, p: float
) -> tuple[complex, complex, complex]:
    """The stack at the total pressure `p`: leak beside the gap beta, 1/a with a = 1 + beta h, and its length z.

    The division is written out: numba's complex one guards against the ends of floating point, at a cost.
    """
    beta = bypass + leak * p
    a = 1.0 + beta * h
    per_square = 1.0 / (a.real * a.real + a.imag * a.imag)
    per_a = complex(per_square * a.real, -per_square * a.imag)
    return beta, per_a, k_gap * h * per_a + shift


@inlined
def gain_of(
    flat: Array, mass: Array, mass_below: Array, gap: Array, p_hat: float, per_a: complex, z_hat: complex,
    reach: float, out: Array,
) -> float:  # fmt: skip
    """(eps0/2) K(p, z)/|a|^2, the pressure per mean square volt, and what `lookup` found in `out`.

    `per_a` is 1/(a h_rms); `reach` is the peak voltage over the cap of the local field, m; 0 without one.
    """
    row, weights, _ = row_of(p_hat)
    length = length_of(z_hat)
    lookup_between(flat, row, weights, length, out)
    field = math.sqrt(per_a.real * per_a.real + per_a.imag * per_a.imag)
    gain = 0.5 * EPS0 * out[0] * field * field
    if reach > 0.0:
        start, closest = first_gap(length[0]), reach * field
        if closest * closest > (gap[start] + z_hat.real) ** 2 + z_hat.imag * z_hat.imag:
            gain *= _kept_share(mass, mass_below, gap, row, weights, z_hat, start, closest)
    return float(gain)


@kernel
def first_gap(log_z: float) -> int:
    """The first gap that is not narrow beside a length of this logarithm."""
    return max(_node_of(log_z + LOG_NARROW), 1)


@kernel
def _node_of(log_u: float) -> int:
    """The node at or below a gap."""
    return int((log_u - LOG_U_AXIS[0]) / LOG_U_AXIS[2])


@kernel
def _kept_share(
    mass: Array, mass_below: Array, gap: Array, row: int, weights: Four, z_hat: complex, start: int, closest: float
) -> float:
    """Share of K^ that a cap on the local field leaves; `closest` is |u + z| at which the field meets it, per h_rms.

    Between four rows of the table; `start` is the first gap that is not narrow.
    """
    x, y_square, closest_square = z_hat.real, z_hat.imag * z_hat.imag, closest * closest
    reach = max(start + 1, min(_node_of(math.log(math.sqrt(closest_square - y_square) - x)), gap.size - 3))
    reach += (gap[reach] + x) ** 2 + y_square < closest_square  # the first gap beyond the cap, rounding or not
    reach += (gap[reach] + x) ** 2 + y_square < closest_square
    lost = _between(mass_below, start, row, weights) / (x * x + y_square)
    lost += _sum_gaps(mass, gap, row, weights, x, y_square, start, reach)
    rest = _sum_gaps(mass, gap, row, weights, x, y_square, reach, gap.size)
    below, above = (gap[reach - 1] + x) ** 2 + y_square, (gap[reach] + x) ** 2 + y_square
    jump_below = jump_of_slope(gap[reach - 1], _between(mass, reach - 1, row, weights), x)
    jump_above = jump_of_slope(gap[reach], _between(mass, reach, row, weights), x)
    edge = edge_of_cap((closest_square - below) / (above - below), jump_below, jump_above)
    held = (_between(mass_below, reach, row, weights) + edge / closest_square) / closest_square
    return float((held + rest) / (lost + rest))


@kernel
def _between(values: Array, m: int, row: int, weights: Four) -> float:
    """A column of the table at a pressure between its rows."""
    w0, w1, w2, w3 = weights
    return float(w0 * values[row, m] + w1 * values[row + 1, m] + w2 * values[row + 2, m] + w3 * values[row + 3, m])


@kernel_of_sums
def _sum_gaps(
    mass: Array, gap: Array, row: int, weights: Four, x: float, y_square: float, start: int, end: int
) -> float:
    """K^ of the gaps from `start` to before `end`."""
    w0, w1, w2, w3 = weights
    total = 0.0
    for m in span(start, end):
        here = w0 * mass[row, m] + w1 * mass[row + 1, m] + w2 * mass[row + 2, m] + w3 * mass[row + 3, m]
        total += here / ((gap[m] + x) ** 2 + y_square)
    return total


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
    flat: Array, mass: Array, mass_below: Array, gap: Array, p_scale: Array, h_scale: Array, h: ComplexArray,
    k_gap: ComplexArray, bypass: ComplexArray, leak: ComplexArray, mean_square: Array, crest: Array, shift: Array,
    load: Array, added: Array, field_limit: Array, result: Array,
) -> None:  # fmt: skip
    """Marching up from the unattracted contact in bounded steps, so that the lowest equilibrium is the one bracketed.

    The share of the drive that each pressure needs must rise on the way; where it turns back, the contact pulls in.
    """
    out = np.empty(LOOKED_UP)
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
                    _, per_a, z = divider(h[i, c], k_gap[i, c], bypass[i, c], leak[i, c], shift[i], p)
                    reach = math.sqrt(crest[i, c] * abs(mean_square[i, c])) / field_limit[i]
                    attraction += mean_square[i, c] * gain_of(
                        flat, mass, mass_below, gap, p / p_scale[i], per_a / h_scale[i], z / h_scale[i], reach, out
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
                step = min(step, p_max) if p < p_max else step  # an equilibrium may lie just inside the table
            elif not below < step < above:
                step = 0.5 * (below + above)
            previous, excess_previous = p, excess
            p = step
        result[i] = solution
