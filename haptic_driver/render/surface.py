"""Look-up and inversion of the surface: the compiled part of a tick.

Axes are uniform in log frequency, log normal force and voltage; between nodes everything is linear, outside it is
clamped and never extrapolated. All kernels and the constants they use stand in this file, so that their compiled cache
notices every change.
"""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Bits = NDArray[np.int64]

MERIT_AUTHORITY, MERIT_VOLTAGE, MERIT_CURRENT = 0, 1, 2


ON_NODE = 1e-9  # of a cell
MOST_CUTS = 30
LOG_FREQUENCY, LOG_NORMAL_FORCE, VOLTAGE = 0, 1, 2  # rows of `Surface.axes`


class Surface(NamedTuple):
    """A surface made ready for look-up, limits of the rig applied.

    `axes` [3, 3]: first node, last node and number of cells of each axis, in the order of the arrays. `cof` and
    `current_rms_a` are [frequency, normal force, voltage]; `voltage_limit_v` [frequency, normal force] is the largest
    voltage that every limit and mask allows there; `stuck_current_a_per_v` [frequency].

    Kernels take the arrays one by one: a compiled call costs 0.1 us per array, and several times that for a record.
    """

    axes: Array
    cof: Array
    current_rms_a: Array
    stuck_current_a_per_v: Array
    voltage_limit_v: Array

    def nodes(self, axis: int) -> Array:
        """The nodes of one axis."""
        first, last, cells = self.axes[axis]
        return np.linspace(first, last, int(cells) + 1)


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
    _cof_many(surface.axes, surface.cof, _LOG2_TABLE, f, f.view(np.int64), n, n.view(np.int64), v, out)
    return out.reshape(np.shape(frequency_hz))


def cof_scalar(surface: Surface, frequency_hz: float, voltage_v: float, normal_force_n: float) -> float:
    """Friction at one point; clamped to the surface."""
    return _cof_one(surface.axes, surface.cof, frequency_hz, voltage_v, normal_force_n)


def invert(
    surface: Surface,
    target_cof: float,
    frequency_hz: float,
    normal_force_n: float,
    voltage_cap_v: float = np.inf,
    current_cap_a: float = np.inf,
) -> Inverse:
    """The smallest voltage that gives `target_cof` at that frequency and load, clamped to what is reachable there.

    The limits of the surface hold at its nodes; the caps hold at a frequency between them.
    """
    return Inverse(*_invert_one(*surface, target_cof, frequency_hz, normal_force_n, voltage_cap_v, current_cap_a))


def stuck_current_a_per_v(surface: Surface, frequency_hz: float) -> float:
    """Worst-case finger current per volt, between nodes as `invert` gives it."""
    i, a = _locate(surface.axes[LOG_FREQUENCY], np.log(frequency_hz))
    return _stuck_per_volt(surface.stuck_current_a_per_v, i, a)


def best_frequency(
    surface: Surface, target_cof: float, normal_force_n: float, first: int, stop: int, merit: int
) -> int:
    """Index of the node in first..stop with most authority, or that reaches the target with least volts or current.

    Where no node reaches the target, the one with most authority.
    """
    return _best_frequency(*surface, target_cof, normal_force_n, first, stop, merit)


@numba.njit(cache=True, nogil=True)
def _cof_one(axes: Array, cof: Array, frequency_hz: float, voltage_v: float, normal_force_n: float) -> float:
    i, a = _locate(axes[LOG_FREQUENCY], np.log(frequency_hz))
    j, b = _locate(axes[LOG_NORMAL_FORCE], np.log(normal_force_n))
    k, c = _locate(axes[VOLTAGE], voltage_v)
    return float(_trilinear(cof, i, a, j, b, k, c))


@numba.njit(cache=True, nogil=True)
def _invert_one(
    axes: Array, cof: Array, current: Array, stuck: Array, limit: Array,
    target_cof: float, frequency_hz: float, normal_force_n: float, voltage_cap: float, current_cap: float,
) -> tuple[float, float, float, float, float, float]:  # fmt: skip
    i, a = _locate(axes[LOG_FREQUENCY], np.log(frequency_hz))
    j, b = _locate(axes[LOG_NORMAL_FORCE], np.log(normal_force_n))
    return _invert(axes, cof, current, stuck, limit, target_cof, i, a, j, b, voltage_cap, current_cap)


@numba.njit(cache=True, nogil=True)
def _best_frequency(
    axes: Array, cof: Array, current: Array, stuck: Array, limit: Array,
    target_cof: float, normal_force_n: float, first: int, stop: int, merit: int,
) -> int:  # fmt: skip
    j, b = _locate(axes[LOG_NORMAL_FORCE], np.log(normal_force_n))
    best, most = first, -1.0
    best_reaching, least = -1, np.inf
    for i in range(first, stop):
        k, c = _locate(axes[VOLTAGE], _voltage_limit(limit, i, 0.0, j, b))
        high = _trilinear(cof, i, 0.0, j, b, k, c)
        if high > most:
            best, most = i, high
        if merit != MERIT_AUTHORITY and high >= target_cof:
            voltage, _, drawn, _, _, _ = _invert(
                axes, cof, current, stuck, limit, target_cof, i, 0.0, j, b, np.inf, np.inf
            )
            cost = voltage if merit == MERIT_VOLTAGE else drawn
            if cost < least:
                best_reaching, least = i, cost
    return best_reaching if best_reaching >= 0 else best


@numba.njit(cache=True, nogil=True)
def _invert(
    axes: Array, cof: Array, current: Array, stuck: Array, limit: Array,
    target_cof: float, i: int, a: float, j: int, b: float,
    voltage_cap: float, current_cap: float,
) -> tuple[float, float, float, float, float, float]:  # fmt: skip
    """The fields of `Inverse`, by bisection over the voltage nodes of one frequency and load."""
    highest_v = min(_voltage_limit(limit, i, a, j, b), voltage_cap)
    last, c = _locate(axes[VOLTAGE], highest_v)
    for _ in range(MOST_CUTS):
        drawn = _trilinear(current, i, a, j, b, last, c)
        if drawn <= current_cap:
            break
        highest_v *= (1.0 - ON_NODE) * current_cap / drawn  # current grows with voltage, a little faster than it
        last, c = _locate(axes[VOLTAGE], highest_v)
    low = _trilinear(cof, i, a, j, b, 0, 0.0)
    high = _trilinear(cof, i, a, j, b, last, c)
    if target_cof <= low:
        voltage, reached = 0.0, low
    elif target_cof >= high:
        voltage, reached = highest_v, high
    else:
        below, above = 0, last + 1
        while above - below > 1:
            middle = (below + above) // 2
            if _trilinear(cof, i, a, j, b, middle, 0.0) <= target_cof:
                below = middle
            else:
                above = middle
        start = _trilinear(cof, i, a, j, b, below, 0.0)
        end = _trilinear(cof, i, a, j, b, above, 0.0)
        first_v, last_v, cells = axes[VOLTAGE]
        position = below + (target_cof - start) / (end - start)
        voltage, reached = min(first_v + position * (last_v - first_v) / cells, highest_v), target_cof
    k, c = _locate(axes[VOLTAGE], voltage)
    drawn = _trilinear(current, i, a, j, b, k, c)
    return voltage, reached, drawn, voltage * _stuck_per_volt(stuck, i, a), low, high


@numba.njit(cache=True, nogil=True)
def _stuck_per_volt(stuck: Array, i: int, a: float) -> float:
    return float((1.0 - a) * stuck[i] + a * stuck[i + 1] if a > 0.0 else stuck[i])


@numba.njit(cache=True, nogil=True)
def _voltage_limit(limit: Array, i: int, a: float, j: int, b: float) -> float:
    """The least of the limits of the nodes around: between an allowed and a forbidden node nothing is allowed."""
    least = float(limit[i, j])
    if a > 0.0:
        least = min(least, limit[i + 1, j])
    if b > 0.0:
        least = min(least, limit[i, j + 1])
        if a > 0.0:
            least = min(least, limit[i + 1, j + 1])
    return least


@numba.njit(cache=True, nogil=True)
def _locate(axis: Array, x: float) -> tuple[int, float]:
    """Node at or below `x` and the fraction beyond it, on an axis (first, last, cells); clamped.

    A node met to rounding is that node, so that no limit of its neighbour is taken for its own.
    """
    position = (x - axis[0]) / (axis[1] - axis[0]) * axis[2]
    position = min(max(position, 0.0), axis[2])
    nearest = np.floor(position + 0.5)
    if abs(position - nearest) < ON_NODE:
        position = nearest
    node = int(position)
    return node, position - node


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
    axes: Array, values: Array, log2_table: Array, frequency_hz: Array, frequency_bits: Bits, normal_force_n: Array,
    normal_force_bits: Bits, voltage_v: Array, out: Array,
) -> None:  # fmt: skip
    """Batch look-up over all cores, without branches and with unsigned indices so that it vectorises.

    The logarithm comes from exponent and mantissa of the number itself; NaN in any input gives NaN.
    """
    cof = values.reshape(-1)
    nf, nn, nv = values.shape
    last_f, last_n, last_v = nf - 1.0, nn - 1.0, nv - 1.0
    stride_f, stride_n, one = np.uint32(nn * nv), np.uint32(nv), np.uint32(1)
    ln2 = np.log(2.0)
    f0, n0, v0 = axes[LOG_FREQUENCY, 0] / ln2, axes[LOG_NORMAL_FORCE, 0] / ln2, axes[VOLTAGE, 0]
    scale_f = last_f / (axes[LOG_FREQUENCY, 1] / ln2 - f0)
    scale_n = last_n / (axes[LOG_NORMAL_FORCE, 1] / ln2 - n0)
    scale_v = last_v / (axes[VOLTAGE, 1] - v0)
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
