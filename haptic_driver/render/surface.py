"""Look-up and inversion of the surface: the compiled part of a tick.

All kernels and the constants they use stand in this file, so that their compiled cache notices every change. Axes are
uniform in log frequency, log normal force and voltage; between nodes everything is linear, outside it is clamped and
never extrapolated.
"""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Bits = NDArray[np.int64]

MERIT_AUTHORITY, MERIT_VOLTAGE, MERIT_CURRENT = 0, 1, 2


class Surface(NamedTuple):
    """A surface made ready for look-up, limits of the rig applied.

    `cof` and `current_rms_a` are [frequency, normal force, voltage]; `voltage_limit_v` [frequency, normal force] is the
    largest voltage that every limit and mask allows there; `stuck_current_a_per_v` [frequency].
    """

    log_frequency: Array
    log_normal_force: Array
    voltage_v: Array
    cof: Array
    current_rms_a: Array
    stuck_current_a_per_v: Array
    voltage_limit_v: Array


class Inverse(NamedTuple):
    """The voltage for a target at one frequency, and what it gives; `cof_high` is the most that is reachable there."""

    voltage_v: float
    cof: float
    current_rms_a: float
    stuck_current_rms_a: float
    cof_low: float
    cof_high: float


def cof_at(surface: Surface, frequency_hz: Array, voltage_v: Array, normal_force_n: Array) -> Array:
    """Friction at n points, any equal shapes; clamped to the surface, NaN where an input is NaN.

    Frequencies and forces must be positive.
    """
    f, v, n = (np.ascontiguousarray(x, dtype=np.float64).ravel() for x in (frequency_hz, voltage_v, normal_force_n))
    out = np.empty(f.shape)
    _cof_many(surface, _LOG2_TABLE, f, f.view(np.int64), n, n.view(np.int64), v, out)
    return out.reshape(np.shape(frequency_hz))


@numba.njit(cache=True, nogil=True)
def cof_scalar(surface: Surface, frequency_hz: float, voltage_v: float, normal_force_n: float) -> float:
    """Friction at one point; clamped to the surface."""
    i, a = _locate(surface.log_frequency, np.log(frequency_hz))
    j, b = _locate(surface.log_normal_force, np.log(normal_force_n))
    k, c = _locate(surface.voltage_v, voltage_v)
    return float(_trilinear(surface.cof, i, a, j, b, k, c))


@numba.njit(cache=True, nogil=True)
def invert(surface: Surface, target_cof: float, frequency_hz: float, normal_force_n: float) -> Inverse:
    """The smallest voltage that gives `target_cof` at that frequency and load, clamped to what is reachable there."""
    i, a = _locate(surface.log_frequency, np.log(frequency_hz))
    j, b = _locate(surface.log_normal_force, np.log(normal_force_n))
    return _invert(surface, target_cof, i, a, j, b)


@numba.njit(cache=True, nogil=True)
def best_frequency(
    surface: Surface, target_cof: float, normal_force_n: float, first: int, stop: int, merit: int
) -> int:
    """Index of the node in first..stop with most authority, or that reaches the target with least volts or current.

    Where no node reaches the target, the one with most authority.
    """
    j, b = _locate(surface.log_normal_force, np.log(normal_force_n))
    best, most = first, -1.0
    best_reaching, least = -1, np.inf
    for i in range(first, stop):
        k, c = _locate(surface.voltage_v, _voltage_limit(surface, i, 0.0, j, b))
        high = _trilinear(surface.cof, i, 0.0, j, b, k, c)
        if high > most:
            best, most = i, high
        if merit != MERIT_AUTHORITY and high >= target_cof:
            inverse = _invert(surface, target_cof, i, 0.0, j, b)
            cost = inverse.voltage_v if merit == MERIT_VOLTAGE else inverse.current_rms_a
            if cost < least:
                best_reaching, least = i, cost
    return best_reaching if best_reaching >= 0 else best


@numba.njit(cache=True, nogil=True)
def _invert(surface: Surface, target_cof: float, i: int, a: float, j: int, b: float) -> Inverse:
    limit = _voltage_limit(surface, i, a, j, b)
    last, c = _locate(surface.voltage_v, limit)
    low = _trilinear(surface.cof, i, a, j, b, 0, 0.0)
    high = _trilinear(surface.cof, i, a, j, b, last, c)
    step = surface.voltage_v[1] - surface.voltage_v[0]
    if target_cof <= low:
        voltage, cof = 0.0, low
    elif target_cof >= high:
        voltage, cof = limit, high
    else:
        below, above = 0, last + 1
        while above - below > 1:
            middle = (below + above) // 2
            if _trilinear(surface.cof, i, a, j, b, middle, 0.0) <= target_cof:
                below = middle
            else:
                above = middle
        start = _trilinear(surface.cof, i, a, j, b, below, 0.0)
        end = _trilinear(surface.cof, i, a, j, b, above, 0.0)
        voltage = min(surface.voltage_v[below] + step * (target_cof - start) / (end - start), limit)
        cof = target_cof
    k, c = _locate(surface.voltage_v, voltage)
    current = _trilinear(surface.current_rms_a, i, a, j, b, k, c)
    per_volt = surface.stuck_current_a_per_v
    stuck = voltage * (per_volt[i] + a * (per_volt[i + 1] - per_volt[i]) if a > 0.0 else per_volt[i])
    return Inverse(voltage, cof, current, stuck, low, high)


@numba.njit(cache=True, nogil=True)
def _voltage_limit(surface: Surface, i: int, a: float, j: int, b: float) -> float:
    """The least of the limits of the nodes around: between an allowed and a forbidden node nothing is allowed."""
    limit = float(surface.voltage_limit_v[i, j])
    if a > 0.0:
        limit = min(limit, surface.voltage_limit_v[i + 1, j])
    if b > 0.0:
        limit = min(limit, surface.voltage_limit_v[i, j + 1])
        if a > 0.0:
            limit = min(limit, surface.voltage_limit_v[i + 1, j + 1])
    return limit


@numba.njit(cache=True, nogil=True)
def _locate(axis: Array, x: float) -> tuple[int, float]:
    """Cell and fraction of `x` on a uniform axis, clamped; the last node is cell n-2 with fraction 1."""
    last = axis.size - 1
    position = (x - axis[0]) / (axis[last] - axis[0]) * last
    position = min(max(position, 0.0), float(last))
    cell = min(int(position), last - 1)
    return cell, position - cell


@numba.njit(cache=True, nogil=True)
def _trilinear(values: Array, i: int, a: float, j: int, b: float, k: int, c: float) -> float:
    if a == 0.0 and b == 0.0 and c == 0.0:
        return float(values[i, j, k])
    i1, j1, k1 = (i + 1 if a > 0.0 else i), (j + 1 if b > 0.0 else j), (k + 1 if c > 0.0 else k)
    d = 1.0 - c
    near = (1.0 - b) * (d * values[i, j, k] + c * values[i, j, k1]) + b * (d * values[i, j1, k] + c * values[i, j1, k1])
    far = (1.0 - b) * (d * values[i1, j, k] + c * values[i1, j, k1]) + b * (
        d * values[i1, j1, k] + c * values[i1, j1, k1]
    )
    return float((1.0 - a) * near + a * far)


_LOG2_CELLS = 1024
_LOG2_TABLE = np.log2(1.0 + np.arange(_LOG2_CELLS + 1) / _LOG2_CELLS)  # of the mantissa; linear between: 2e-7


@numba.njit(cache=True, nogil=True, parallel=True, fastmath={"contract", "reassoc", "nsz", "arcp"}, error_model="numpy")
def _cof_many(
    surface: Surface, log2_table: Array, frequency_hz: Array, frequency_bits: Bits, normal_force_n: Array,
    normal_force_bits: Bits, voltage_v: Array, out: Array,
) -> None:  # fmt: skip
    """Batch look-up over all cores, without branches and with unsigned indices so that it vectorises.

    The logarithm comes from exponent and mantissa of the number itself; NaN in any input gives NaN.
    """
    cof = surface.cof.reshape(-1)
    nf, nn, nv = surface.cof.shape
    last_f, last_n, last_v = nf - 1.0, nn - 1.0, nv - 1.0
    stride_f, stride_n, one = np.uint32(nn * nv), np.uint32(nv), np.uint32(1)
    ln2 = np.log(2.0)
    f0, n0, v0 = surface.log_frequency[0] / ln2, surface.log_normal_force[0] / ln2, surface.voltage_v[0]
    scale_f = last_f / (surface.log_frequency[nf - 1] / ln2 - f0)
    scale_n = last_n / (surface.log_normal_force[nn - 1] / ln2 - n0)
    scale_v = last_v / (surface.voltage_v[nv - 1] - v0)
    for m in numba.prange(out.size):
        x = (_log2(frequency_bits[m], log2_table) - f0) * scale_f
        y = (_log2(normal_force_bits[m], log2_table) - n0) * scale_n
        z = (voltage_v[m] - v0) * scale_v
        x = x if x > 0.0 else 0.0
        x = x if x < last_f else last_f
        y = y if y > 0.0 else 0.0
        y = y if y < last_n else last_n
        z = z if z > 0.0 else 0.0
        z = z if z < last_v else last_v
        i, j, k = (
            min(np.int32(x), np.int32(nf - 2)),
            min(np.int32(y), np.int32(nn - 2)),
            min(np.int32(z), np.int32(nv - 2)),
        )
        a, b, c = x - i, y - j, z - k
        p = np.uint32(i) * stride_f + np.uint32(j) * stride_n + np.uint32(k)
        q = p + stride_f
        near0 = cof[p] + c * (cof[p + one] - cof[p])
        near1 = cof[p + stride_n] + c * (cof[p + stride_n + one] - cof[p + stride_n])
        far0 = cof[q] + c * (cof[q + one] - cof[q])
        far1 = cof[q + stride_n] + c * (cof[q + stride_n + one] - cof[q + stride_n])
        near = near0 + b * (near1 - near0)
        nan_if_nan = 0.0 * (frequency_hz[m] + normal_force_n[m] + voltage_v[m])
        out[m] = near + a * (far0 + b * (far1 - far0) - near) + nan_if_nan


@numba.njit(cache=True, nogil=True, inline="always")
def _log2(bits: int, table: Array) -> float:
    """log2 of the positive float64 with these bits."""
    cell = np.uint32((bits >> 42) & 1023)
    fraction = (bits & 0x3FFFFFFFFFF) * (1.0 / (1 << 42))
    return float(((bits >> 52) - 1023) + table[cell] + fraction * (table[cell + np.uint32(1)] - table[cell]))
