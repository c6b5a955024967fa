"""The gap integrals where compiled code needs them: K^, L^, and what a limit of the field leaves of
K^.

Between the nodes of the table everything is cubic. What K^ and L^ are stands in `gap_table`, which
makes the table.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from model.contact.resolution import ANGLE_AXIS, LOG_P_AXIS, LOG_U_AXIS, LOG_Z_AXIS
from model.support.arrays import Array
from model.support.compiled import kernel, kernel_of_sums

NARROW = 1e-4  # of the stack's length: in narrower gaps the field is that of none

Four = tuple[float, float, float, float]
Rows = tuple[Array, Array, Array, Array]


class TableArrays(NamedTuple):
    """What compiled code takes of a `GapTable`: log K^ and the complex log L^ [p, z, angle].

    Of the gaps [u] themselves: `mass` P(u) du [p, u], and `mass_below` of all smaller ones.
    """

    log_k: Array
    log_l: NDArray[np.complex128]
    gap: Array
    mass: Array
    mass_below: Array


@kernel
def k_hat(table: TableArrays, p_hat: float, z_hat: complex) -> float:
    """K^ at one point, by local cubic interpolation on four nodes per axis.

    3e-5 of the direct quadrature (4e-4 near the highest pressures, where hardly a gap is left).
    Beyond the lengths of the table its limits hold: K ~ 1/|z| below (P is constant there), K ~
    1/|z|^2 and L ~ 1/z above. Beyond its pressures the nearest holds. K(conj z) = K(z), L(conj z) =
    conj L(z).
    """
    log_z, angle = polar(z_hat)
    below, above = max(LOG_Z_AXIS[0] - log_z, 0.0), max(log_z - LOG_Z_AXIS[1], 0.0)
    return float(
        np.exp(interpolated(table.log_k, math.log(p_hat), log_z, abs(angle)) + below - 2.0 * above)
    )


@kernel
def l_hat(table: TableArrays, p_hat: float, z_hat: complex) -> complex:
    """L^ at one point, likewise."""
    log_z, angle = polar(z_hat)
    found = np.exp(
        interpolated(table.log_l, math.log(p_hat), log_z, abs(angle))
        - max(log_z - LOG_Z_AXIS[1], 0.0)
    )
    return complex(found) if angle >= 0.0 else complex(found.conjugate())


@kernel
def polar(z: complex) -> tuple[float, float]:
    """Logarithm of the magnitude, and angle."""
    return 0.5 * math.log(z.real * z.real + z.imag * z.imag), math.atan2(z.imag, z.real)


@kernel
def interpolated(values: NDArray[Any], log_p: float, log_z: float, angle: float) -> Any:
    """Between four nodes on each axis of a table."""
    i, p_weights = stencil(log_p, LOG_P_AXIS)
    j, z_weights = stencil(log_z, LOG_Z_AXIS)
    k, (a0, a1, a2, a3) = stencil(angle, ANGLE_AXIS)
    total = 0.0 * values[0, 0, 0]
    for m in range(4):
        for n in range(4):
            along = values[i + m, j + n]
            at_angle = a0 * along[k] + a1 * along[k + 1] + a2 * along[k + 2] + a3 * along[k + 3]
            total += p_weights[m] * z_weights[n] * at_angle
    return total


@kernel
def stencil(x: float, axis: tuple[float, float, int]) -> tuple[int, Four]:
    """The first of the four nodes around `x` on an axis and their Lagrange weights; beyond an end
    those of the end.
    """
    low, high, count = axis
    position = (min(max(x, low), high) - low) / (high - low) * (count - 1)
    first = min(max(int(position) - 1, 0), count - 4)
    t = position - first
    t1, t2, t3 = t - 1.0, t - 2.0, t - 3.0
    return first, (-t1 * t2 * t3 / 6.0, t * t2 * t3 / 2.0, -t * t1 * t3 / 2.0, t * t1 * t2 / 6.0)


@kernel_of_sums
def kept_share(table: TableArrays, p_hat: float, z_hat: complex, closest_square: float) -> float:
    """Share of K^ that is left where the local field cannot exceed a limit, which it meets at a
    certain |u + z|^2.

    Where the limit ends the integrand has a kink in log u, for which the trapezoid rule is
    corrected (Euler-Maclaurin).
    """
    row, weights = stencil(math.log(p_hat), LOG_P_AXIS)
    x, y_square, limit = z_hat.real, z_hat.imag * z_hat.imag, 1.0 / closest_square
    narrow = _gap_below(NARROW * math.sqrt(x * x + y_square))
    gap, rows = table.gap[narrow:], _four_rows(table.mass, row, narrow)
    mass = _at_pressure(_four_rows(table.mass_below, row, narrow), weights, 0)
    kept, whole = mass * limit, mass / (x * x + y_square)
    for m in range(gap.size):
        mass = _at_pressure(rows, weights, m)
        field_square = 1.0 / ((gap[m] + x) ** 2 + y_square)
        kept += mass * min(field_square, limit)
        whole += mass * field_square
    m = min(max(_gap_below(math.sqrt(closest_square - y_square) - x) - narrow, 0), gap.size - 2)
    u, v = gap[m], gap[m + 1]
    below, above = (u + x) ** 2 + y_square, (v + x) ** 2 + y_square
    t = min(max((closest_square - below) / (above - below), 0.0), 1.0)
    jump = (1.0 - t) * u * (u + x) * _at_pressure(rows, weights, m)
    jump += t * v * (v + x) * _at_pressure(rows, weights, m + 1)
    kept -= LOG_U_AXIS[2] * jump * (t * (t - 1.0) + 1.0 / 6.0) * limit * limit
    return float(kept / whole)


@kernel
def _gap_below(u: float) -> int:
    """Number of the gap at or below a length in h_rms; the first for shorter ones."""
    return int(max((math.log(u) - LOG_U_AXIS[0]) / LOG_U_AXIS[2], 0.0)) if u > 0.0 else 0


@kernel
def _four_rows(values: Array, row: int, start: int) -> Rows:
    """Four rows of the table from a column on, for a loop that runs on vectors."""
    return (
        values[row, start:],
        values[row + 1, start:],
        values[row + 2, start:],
        values[row + 3, start:],
    )


@kernel
def _at_pressure(rows: Rows, weights: Four, m: int) -> float:
    """A column at a pressure between four rows."""
    return float(
        weights[0] * rows[0][m]
        + weights[1] * rows[1][m]
        + weights[2] * rows[2][m]
        + weights[3] * rows[3][m]
    )
