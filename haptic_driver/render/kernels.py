"""Every compiled kernel of a tick: look-up, inversion, choice of the frequency, correction, feedback.

They stand in one file, with the constants that they use, so that numba's cache notices every change. Arrays are taken
one by one: a compiled call costs 0.1 us per array, and several times that for a record of them. What the arguments
mean stands with the records they come from: `Surface`, `Correction`, `FeedbackSettings`, `Estimate`.
"""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Bits = NDArray[np.int64]

MERIT_AUTHORITY, MERIT_VOLTAGE, MERIT_CURRENT = 0, 1, 2
LOG_FREQUENCY, LOG_NORMAL_FORCE, VOLTAGE = 0, 1, 2  # rows of `Surface.axes`
ON_NODE = 1e-9  # of a cell
MOST_CUTS = 30
CORRECTION_ROUNDS = 4
FREQUENCY_ROUNDS = 2  # of them choose the frequency too; later ones find the voltage alone
READING_TIME = 12  # index in `Estimate`
PATIENCE_S = 1.0  # without a reading for so long there is no feedback to be careful for
CAUTION_CUTS = 20  # halvings of the rise; leaves 1e-6 of it
WORTH_COMPARING_V, WORTH_COMPARING_A = 1.0, 1e-6  # below, costs are as good as equal


@numba.njit(cache=True, nogil=True)
def cof_one(axes: Array, cof: Array, frequency_hz: float, voltage_v: float, normal_force_n: float) -> float:
    """Friction at one point; clamped to the surface."""
    i, a = locate(axes[LOG_FREQUENCY], np.log(frequency_hz))
    j, b = locate(axes[LOG_NORMAL_FORCE], np.log(normal_force_n))
    k, c = locate(axes[VOLTAGE], voltage_v)
    return float(trilinear(cof, i, a, j, b, k, c))


@numba.njit(cache=True, nogil=True)
def invert_one(
    axes: Array, cof: Array, current: Array, stuck: Array, limit: Array,
    target_cof: float, frequency_hz: float, normal_force_n: float, voltage_cap: float, current_cap: float,
) -> tuple[float, float, float, float, float, float]:  # fmt: skip
    """The fields of `Inverse` at one frequency and load; infinite caps for none."""
    i, a = locate(axes[LOG_FREQUENCY], np.log(frequency_hz))
    j, b = locate(axes[LOG_NORMAL_FORCE], np.log(normal_force_n))
    return _invert(axes, cof, current, stuck, limit, target_cof, i, a, j, b, voltage_cap, current_cap)


@numba.njit(cache=True, nogil=True)
def highest_cof(axes: Array, cof: Array, limit: Array, out: Array) -> None:
    """`out` [normal force cell, frequency, 2]: the most friction that both loads of a cell have at its lower limit.

    What `best_frequency` reads in a row, which otherwise lies a page apart from one frequency to the next.
    """
    for j in range(cof.shape[1] - 1):
        for i in range(cof.shape[0]):
            k, c = locate(axes[VOLTAGE], min(limit[i, j], limit[i, j + 1]))
            out[j, i, 0], out[j, i, 1] = trilinear(cof, i, 0.0, j, 0.0, k, c), trilinear(cof, i, 0.0, j + 1, 0.0, k, c)


@numba.njit(cache=True, nogil=True)
def best_frequency(
    axes: Array, cof: Array, current: Array, stuck: Array, limit: Array, highest: Array,
    target_cof: float, normal_force_n: float, first: int, stop: int, merit: int,
) -> int:  # fmt: skip
    """Index of the best node in first..stop; see `surface.best_frequency`. `highest` is of `highest_cof`."""
    j, b = locate(axes[LOG_NORMAL_FORCE], np.log(normal_force_n))
    best, most = first, -1.0
    best_reaching, least = -1, np.inf
    for i in range(first, stop):
        if b > 0.0:
            high = (1.0 - b) * highest[j, i, 0] + b * highest[j, i, 1]
        else:
            k, c = locate(axes[VOLTAGE], limit[i, j])
            high = trilinear(cof, i, 0.0, j, 0.0, k, c)
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
    last, c = locate(axes[VOLTAGE], highest_v)
    for _ in range(MOST_CUTS):
        drawn = trilinear(current, i, a, j, b, last, c)
        if drawn <= current_cap:
            break
        highest_v *= (1.0 - ON_NODE) * current_cap / drawn  # current grows with voltage, a little faster than it
        last, c = locate(axes[VOLTAGE], highest_v)
    low = trilinear(cof, i, a, j, b, 0, 0.0)
    high = trilinear(cof, i, a, j, b, last, c)
    if target_cof <= low:
        voltage, reached = 0.0, low
    elif target_cof >= high:
        voltage, reached = highest_v, high
    else:
        below, above = 0, last + 1
        while above - below > 1:
            middle = (below + above) // 2
            if trilinear(cof, i, a, j, b, middle, 0.0) <= target_cof:
                below = middle
            else:
                above = middle
        start = trilinear(cof, i, a, j, b, below, 0.0)
        end = trilinear(cof, i, a, j, b, above, 0.0)
        first_v, last_v, cells = axes[VOLTAGE]
        position = below + (target_cof - start) / (end - start)
        voltage, reached = min(first_v + position * (last_v - first_v) / cells, highest_v), target_cof
    k, c = locate(axes[VOLTAGE], voltage)
    drawn = trilinear(current, i, a, j, b, k, c)
    return voltage, reached, drawn, voltage * stuck_per_volt(stuck, i, a), low, high


@numba.njit(cache=True, nogil=True, error_model="numpy")
def choose(
    axes: Array, cof: Array, current: Array, stuck: Array, limit: Array, highest: Array,
    log_f: Array, log_n: Array, log_s: Array, volts: Array, times: Array,
    off_factor: Array, gain_factor: Array, time_factor: Array, corrected: bool,
    first: int, stop: int, merit: int, fixed_hz: float, hysteresis: float, voltage_cap: float, current_cap: float,
    known: Array, margin: float,
    target_cof: float, normal_force_n: float, speed_m_s: float, time_s: float, present_hz: float,
) -> tuple[float, float, float, float, float, float, float]:  # fmt: skip
    """Frequency, and the fields of `Inverse` there for this finger: cof = off_gain off + rise_gain rise.

    The correction's factors depend on the drive that the target asks for, so both are found together, in a few rounds.
    Then the rise is cut back until the friction expected plus one standard deviation is within `margin` of the target.
    """
    off_gain, rise_gain, off_variance, covariance, rise_variance = gains(known, time_s)
    off, gain = off_gain, rise_gain
    low = trilinear(cof, first, 0.0, *locate(axes[LOG_NORMAL_FORCE], np.log(normal_force_n)), 0, 0.0)
    frequency_hz = present_hz
    inverse = (0.0, low, 0.0, 0.0, low, low)
    for k in range(1 + CORRECTION_ROUNDS if corrected else 1):
        if k > 0:
            of_off, of_rise = correction_factors(
                log_f, log_n, log_s, volts, times, off_factor, gain_factor, time_factor,
                frequency_hz, inverse[0], normal_force_n, speed_m_s, time_s,
            )  # fmt: skip
            off, gain = off_gain * of_off, rise_gain * of_rise
        wanted = low + (target_cof - off * low) / gain
        if k <= FREQUENCY_ROUNDS and np.isnan(fixed_hz):
            frequency_hz = _best_or_present(
                axes, cof, current, stuck, limit, highest,
                wanted, normal_force_n, first, stop, merit, hysteresis, present_hz,
            )  # fmt: skip
        elif k == 0:
            frequency_hz = fixed_hz
        inverse = invert_one(
            axes, cof, current, stuck, limit, wanted, frequency_hz, normal_force_n, voltage_cap, current_cap
        )
    reach_low, reach_high = inverse[4], inverse[5]
    per_off, per_rise = off / off_gain, gain / rise_gain
    cautious = _cautious_rise(
        per_off * low, per_rise * (inverse[1] - low), (1.0 + margin) * target_cof,
        off_gain, rise_gain, off_variance, covariance, rise_variance,
    )  # fmt: skip
    if low + cautious / per_rise < inverse[1]:
        inverse = invert_one(
            axes, cof, current, stuck, limit,
            low + cautious / per_rise, frequency_hz, normal_force_n, voltage_cap, current_cap,
        )  # fmt: skip
    base = (off - gain) * low
    voltage, reached, drawn, stuck_drawn, _, _ = inverse
    return (
        frequency_hz, voltage, base + gain * reached, drawn, stuck_drawn, base + gain * reach_low,
        base + gain * reach_high,
    )  # fmt: skip


@numba.njit(cache=True, nogil=True, error_model="numpy")
def voltages(
    axes: Array, cof: Array, current: Array, stuck: Array, limit: Array,
    log_f: Array, log_n: Array, log_s: Array, volts: Array, times: Array,
    off_factor: Array, gain_factor: Array, time_factor: Array, corrected: bool,
    voltage_cap: float, current_cap: float, known: Array, margin: float,
    target_cof: Array, frequency_hz: float, normal_force_n: float, speed_m_s: float, time_s: float, out_v: Array,
) -> tuple[float, float, float, float, float, float]:  # fmt: skip
    """`out_v` for each target, as `choose` finds it at one frequency; returns the fields of `Inverse` at the highest.

    The correction's factors are those of the highest target's drive.
    """
    off_gain, rise_gain, off_variance, covariance, rise_variance = gains(known, time_s)
    i, a = locate(axes[LOG_FREQUENCY], np.log(frequency_hz))
    j, b = locate(axes[LOG_NORMAL_FORCE], np.log(normal_force_n))
    most = _invert(axes, cof, current, stuck, limit, np.inf, i, a, j, b, voltage_cap, current_cap)
    highest_v, low, high = most[0], most[4], most[5]
    first_v, last_v, _ = axes[VOLTAGE]
    row = np.empty(cof.shape[2])
    i1, j1 = (i + 1 if a > 0.0 else i), (j + 1 if b > 0.0 else j)
    for k in range(row.size):
        near = (1.0 - b) * cof[i, j, k] + b * cof[i, j1, k]
        row[k] = (1.0 - a) * near + a * ((1.0 - b) * cof[i1, j, k] + b * cof[i1, j1, k])
    largest = 0.0
    for m in range(target_cof.size):
        largest = max(largest, target_cof[m])
    of_off, of_rise = 1.0, 1.0
    for _ in range(CORRECTION_ROUNDS if corrected else 0):
        wanted = low + (largest - off_gain * of_off * low) / (rise_gain * of_rise)
        of_off, of_rise = correction_factors(
            log_f, log_n, log_s, volts, times, off_factor, gain_factor, time_factor, frequency_hz,
            _on_row(row, min(wanted, high), first_v, last_v, highest_v), normal_force_n, speed_m_s, time_s,
        )  # fmt: skip
    off, gain = off_gain * of_off, rise_gain * of_rise
    peak_v, peak_cof = 0.0, low
    for m in range(target_cof.size):
        out_v[m] = 0.0
        wanted = low + (target_cof[m] - off * low) / gain
        if not wanted > low:
            continue
        rise = min(wanted, high) - low
        cautious = _cautious_rise(
            of_off * low, of_rise * rise, (1.0 + margin) * target_cof[m],
            off_gain, rise_gain, off_variance, covariance, rise_variance,
        ) / of_rise  # fmt: skip
        out_v[m] = _on_row(row, low + min(rise, cautious), first_v, last_v, highest_v)
        if out_v[m] > peak_v:
            peak_v, peak_cof = out_v[m], low + min(rise, cautious)
    k, c = locate(axes[VOLTAGE], peak_v)
    base = (off - gain) * low
    return (
        peak_v, base + gain * peak_cof, trilinear(current, i, a, j, b, k, c), peak_v * stuck_per_volt(stuck, i, a),
        base + gain * low, base + gain * high,
    )  # fmt: skip


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _on_row(row: Array, wanted: float, first_v: float, last_v: float, highest_v: float) -> float:
    """The smallest voltage that gives `wanted` on one row of the surface, at most `highest_v`."""
    if wanted <= row[0]:
        return 0.0
    below, above = 0, row.size - 1
    while above - below > 1:
        middle = (below + above) // 2
        if row[middle] <= wanted:
            below = middle
        else:
            above = middle
    place = below + (wanted - row[below]) / (row[above] - row[below])
    return float(min(first_v + place * (last_v - first_v) / (row.size - 1), highest_v))


@numba.njit(cache=True, nogil=True, error_model="numpy")
def gains(known: Array, time_s: float) -> tuple[float, float, float, float, float]:
    """Both gains of an `Estimate` and their covariance; none of it while no force is measured, or caution stayed."""
    measured = time_s - known[READING_TIME] < PATIENCE_S
    of_deviation = 1.0 if measured else 0.0
    return known[0], known[1], of_deviation * known[2], of_deviation * known[3], of_deviation * known[4]


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _cautious_rise(
    off: float, rise: float, most: float,
    off_gain: float, rise_gain: float, off_variance: float, covariance: float, rise_variance: float,
) -> float:  # fmt: skip
    """The largest part of `rise` that keeps the friction expected plus one standard deviation at or below `most`."""
    low, high, tried = 0.0, rise, rise
    for _ in range(CAUTION_CUTS):
        variance = off_variance * off * off + 2.0 * covariance * off * tried + rise_variance * tried * tried
        if off_gain * off + rise_gain * tried + np.sqrt(max(variance, 0.0)) <= most:
            low = tried
            if tried == rise:
                break
        else:
            high = tried
        tried = 0.5 * (low + high)
    return low


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _best_or_present(
    axes: Array, cof: Array, current: Array, stuck: Array, limit: Array, highest: Array,
    target_cof: float, normal_force_n: float, first: int, stop: int, merit: int, hysteresis: float, present_hz: float,
) -> float:  # fmt: skip
    """The best frequency, or the present one while that is not clearly worse; NaN for none."""
    f0, f1, cells = axes[LOG_FREQUENCY]
    best_hz = np.exp(f0 + best_frequency(
        axes, cof, current, stuck, limit, highest, target_cof, normal_force_n, first, stop, merit
    ) * (f1 - f0) / cells)  # fmt: skip
    if np.isnan(present_hz) or present_hz == best_hz:
        return float(best_hz)
    best = invert_one(axes, cof, current, stuck, limit, target_cof, best_hz, normal_force_n, np.inf, np.inf)
    present = invert_one(axes, cof, current, stuck, limit, target_cof, present_hz, normal_force_n, np.inf, np.inf)
    (best_low, best_high), (present_low, present_high) = best[4:], present[4:]
    clearly = 1.0 + hysteresis
    if present_high < target_cof <= best_high:
        better = True
    elif merit == MERIT_AUTHORITY or present_high < target_cof:
        better = best_high - best_low > clearly * (present_high - present_low)
    elif merit == MERIT_VOLTAGE:
        better = present[0] > WORTH_COMPARING_V and present[0] > clearly * best[0]
    else:
        better = present[2] > WORTH_COMPARING_A and present[2] > clearly * best[2]
    return float(best_hz if better else present_hz)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def correction_factors(
    log_f: Array, log_n: Array, log_s: Array, volts: Array, times: Array,
    off_factor: Array, gain_factor: Array, time_factor: Array,
    frequency_hz: float, voltage_v: float, normal_force_n: float, speed_m_s: float, time_s: float,
) -> tuple[float, float]:  # fmt: skip
    """Factors on friction without voltage and on the rise through attraction; see `Correction`."""
    n, n_share = _among(log_n, np.log(normal_force_n))
    s, s_share = _among(log_s, np.log(max(speed_m_s, 1e-9)))
    f, f_share = _among(log_f, np.log(frequency_hz))
    v, v_share = _among(volts, voltage_v)
    t, t_share = _among(times, time_s)
    off, gain = 0.0, 0.0
    for i in range(2):
        for j in range(2):
            share = (n_share if i else 1.0 - n_share) * (s_share if j else 1.0 - s_share)
            off += share * off_factor[n + i, s + j]
            for k in range(2):
                for m in range(2):
                    part = share * (f_share if k else 1.0 - f_share) * (v_share if m else 1.0 - v_share)
                    gain += part * gain_factor[f + k, n + i, s + j, v + m]
    of_time = (1.0 - t_share) * time_factor[t] + t_share * time_factor[t + 1]
    return of_time * off, of_time * gain


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _among(nodes: Array, x: float) -> tuple[int, float]:
    """Cell and fraction of `x` among rising nodes, clamped."""
    cell = min(max(int(np.searchsorted(nodes, x)) - 1, 0), nodes.size - 2)
    return cell, min(max((x - nodes[cell]) / (nodes[cell + 1] - nodes[cell]), 0.0), 1.0)


@numba.njit(cache=True, nogil=True)
def stuck_per_volt(stuck: Array, i: int, a: float) -> float:
    """Worst-case finger current per volt, between nodes `i` and `i + 1`."""
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
def locate(axis: Array, x: float) -> tuple[int, float]:
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
def trilinear(values: Array, i: int, a: float, j: int, b: float, k: int, c: float) -> float:
    """Values [f, n, v] at a place between nodes: node and fraction beyond it for each axis."""
    if a == 0.0 and b == 0.0 and c == 0.0:
        return float(values[i, j, k])
    i1, j1, k1 = (i + 1 if a > 0.0 else i), (j + 1 if b > 0.0 else j), (k + 1 if c > 0.0 else k)
    d = 1.0 - c
    near = (1.0 - b) * (d * values[i, j, k] + c * values[i, j, k1]) + b * (d * values[i, j1, k] + c * values[i, j1, k1])
    far = (1.0 - b) * (d * values[i1, j, k] + c * values[i1, j, k1]) + b * (
        d * values[i1, j1, k] + c * values[i1, j1, k1]
    )
    return float((1.0 - a) * near + a * far)


LOG2_CELLS = 1024
LOG2_TABLE = np.log2(1.0 + np.arange(LOG2_CELLS + 1) / LOG2_CELLS)  # of the mantissa; linear between: 2e-7


@numba.njit(cache=True, nogil=True, parallel=True, fastmath={"contract", "reassoc", "nsz", "arcp"}, error_model="numpy")
def cof_many(
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


class FeedbackSettings(NamedTuple):
    """How the finger's gains are learnt; see `render/feedback.py` for the law.

    `latency_s`: from a command until the force sensor reports its effect; `timing_s`: by how much that may be off.
    `time_constant_s` of learning, once the finger is known; `memory_s`: how fast what was learnt may become wrong.
    `deviation` and `correlation` of the two gains from finger to finger, before anything was measured. `lowest_gain`,
    `highest_gain`: bounds. `slowest_m_s`, `settled_m`: slower, and before that way in one stroke, nothing is learnt.
    `cutoff_hz_per_m_s`: friction follows voltage with a first-order lag of that cut-off per speed (13.8 Hz per mm/s,
    arXiv 2505.11162). `margin`: by how much friction may exceed the target, one standard deviation of the gains
    included.
    """

    latency_s: float
    timing_s: float = 0.010
    time_constant_s: float = 0.050
    memory_s: float = 8.0
    deviation: float = 0.4
    correlation: float = 0.5
    lowest_gain: float = 0.3
    highest_gain: float = 3.0
    slowest_m_s: float = 0.003
    settled_m: float = 0.0003
    cutoff_hz_per_m_s: float = 13.8e3
    margin: float = 0.035


class Estimate(NamedTuple):
    """What is known of the finger: cof = `off_gain` x friction without voltage + `rise_gain` x rise by attraction.

    With their covariance. `gain` is what both make of the friction at the present drive, `gain_rate_per_s` its drift,
    smoothed. `learning` is 1 when the last sample taught anything, `at_limit` is 1 while a gain stands at its bound.
    `expected_off_n` and `expected_rise_n`: lateral force by the surface alone, lagged as friction lags; NaN without
    contact. `reading_time_s` and the forces are those of the last new reading; `slid_m` the way of this stroke.
    """

    off_gain: float
    rise_gain: float
    off_variance: float
    covariance: float
    rise_variance: float
    gain: float
    gain_rate_per_s: float
    learning: float
    at_limit: float
    expected_off_n: float
    expected_rise_n: float
    time_s: float
    reading_time_s: float
    normal_force_n: float
    lateral_force_n: float
    slid_m: float


LEAST_FORCE_N = 1e-9
LARGEST_SURPRISE = 0.5  # of the force expected; more is an outlier and counts as so much
RAMP = 0.5  # of the change that commands make within the timing window: error of what is expected
LEAST_PACE = 0.1  # slower is a standstill: the output ramps
LONGEST_STEP_S = 0.010  # no reading teaches more than so much time would
RATE_TIME_CONSTANT_S = 0.5
SOME_FREQUENCY_HZ = 1e3  # for a look-up at zero voltage, where it does not matter


@numba.njit(cache=True, nogil=True, error_model="numpy")
def learn(
    axes: Array, cof: Array,
    log_f: Array, log_n: Array, log_s: Array, volts: Array, times: Array,
    off_factor: Array, gain_factor: Array, time_factor: Array, corrected: bool,
    law: Array, known: Array, commands: Array, then_known: Array, then_commands: Array,
    time_s: float, speed_m_s: float, normal_force_n: float, lateral_force_n: float, in_contact: bool,
    applied_hz: float, applied_v: float,
) -> None:  # fmt: skip
    """One more sample of the finger, and the command that went out before it: writes `then_known`, `then_commands`.

    `law` and `known` are the fields of `FeedbackSettings` and `Estimate` in a row: compiled calls take arrays faster
    than records. `commands` [3, n]: time, frequency and voltage, newest first; NaN for a voltage
    that is on its way while the output comes on.
    """
    then_commands[:, 1:] = commands[:, :-1]
    then_commands[0, 0], then_commands[1, 0], then_commands[2, 0] = time_s, applied_hz, applied_v
    then = _learnt(
        axes, cof, log_f, log_n, log_s, volts, times, off_factor, gain_factor, time_factor, corrected,
        FeedbackSettings(
            law[0], law[1], law[2], law[3], law[4], law[5], law[6], law[7], law[8], law[9], law[10], law[11]
        ),
        Estimate(
            known[0], known[1], known[2], known[3], known[4], known[5], known[6], known[7], known[8], known[9],
            known[10], known[11], known[12], known[13], known[14], known[15],
        ),
        then_commands, time_s, speed_m_s, normal_force_n, lateral_force_n, in_contact,
    )  # fmt: skip
    for k in range(then_known.size):
        then_known[k] = then[k]


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _learnt(
    axes: Array, cof: Array,
    log_f: Array, log_n: Array, log_s: Array, volts: Array, times: Array,
    off_factor: Array, gain_factor: Array, time_factor: Array, corrected: bool,
    law: FeedbackSettings, known: Estimate, commands: Array,
    time_s: float, speed_m_s: float, normal_force_n: float, lateral_force_n: float, in_contact: bool,
) -> Estimate:  # fmt: skip
    """What is known after one more sample; the law is told in `render/feedback.py`."""
    elapsed_s = time_s - known.time_s
    if not 0.0 <= elapsed_s < np.inf:  # the first sample, one without a time, or a clock that began again
        elapsed_s = 0.0
    prior = law.deviation**2
    if not in_contact:
        return _forgotten(known, law, -np.expm1(-elapsed_s / law.memory_s), time_s)
    lagged_off_n, lagged_rise_n, spread_n, steady = _expected(
        axes, cof, log_f, log_n, log_s, volts, times, off_factor, gain_factor, time_factor, corrected,
        law, known, commands, time_s, elapsed_s, speed_m_s, normal_force_n,
    )  # fmt: skip
    slid_m = known.slid_m + speed_m_s * elapsed_s if speed_m_s >= law.slowest_m_s else 0.0
    a, b = known.off_gain, known.rise_gain
    p, q, r = known.off_variance, known.covariance, known.rise_variance
    expected_n = a * lagged_off_n + b * lagged_rise_n
    new = np.isfinite(lateral_force_n) and not (
        lateral_force_n == known.lateral_force_n and normal_force_n == known.normal_force_n
    )
    along_off = p * lagged_off_n + q * lagged_rise_n
    along_rise = q * lagged_off_n + r * lagged_rise_n
    variance = lagged_off_n * along_off + lagged_rise_n * along_rise
    pace = variance / (variance + (RAMP * b * spread_n) ** 2) if steady else 0.0
    learning = new and slid_m >= law.settled_m and pace >= LEAST_PACE
    gain, rate = known.gain, known.gain_rate_per_s
    at_limit = known.at_limit
    if learning:
        since_s = time_s - known.reading_time_s
        worth_s = pace * min(since_s if since_s >= 0.0 else elapsed_s, LONGEST_STEP_S)
        share = -np.expm1(-worth_s / _time_constant_s(law, np.sqrt(variance) / expected_n))
        surprise_n = abs(lateral_force_n) - expected_n
        bound_n = LARGEST_SURPRISE * expected_n
        step = share * min(max(surprise_n, -bound_n), bound_n) / variance
        wanted_a, wanted_b = a + step * along_off, b + step * along_rise
        a = min(max(wanted_a, law.lowest_gain), law.highest_gain)
        b = min(max(wanted_b, law.lowest_gain), law.highest_gain)
        at_limit = 1.0 if a != wanted_a or b != wanted_b else 0.0
        forget = -np.expm1(-worth_s / law.memory_s)
        p += forget * (prior - p) - share * along_off * along_off / variance
        q += forget * (law.correlation * prior - q) - share * along_off * along_rise / variance
        r += forget * (prior - r) - share * along_rise * along_rise / variance
        gain = (a * lagged_off_n + b * lagged_rise_n) / (lagged_off_n + lagged_rise_n)
        if elapsed_s > 0.0:
            smooth = -np.expm1(-elapsed_s / RATE_TIME_CONSTANT_S)
            rate += smooth * ((gain - known.gain) / elapsed_s - rate)
    return Estimate(
        a, b, p, q, r, gain, rate, 1.0 if learning else 0.0, at_limit, lagged_off_n, lagged_rise_n, time_s,
        time_s if new else known.reading_time_s, normal_force_n, lateral_force_n if new else known.lateral_force_n,
        slid_m,
    )  # fmt: skip


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _expected(
    axes: Array, cof: Array,
    log_f: Array, log_n: Array, log_s: Array, volts: Array, times: Array,
    off_factor: Array, gain_factor: Array, time_factor: Array, corrected: bool,
    law: FeedbackSettings, known: Estimate, commands: Array,
    time_s: float, elapsed_s: float, speed_m_s: float, normal_force_n: float,
) -> tuple[float, float, float, bool]:  # fmt: skip
    """Lateral forces by the surface alone, without voltage and by attraction, and the latter's change around then.

    Last, whether one carrier held all the while.
    """
    frequency_hz, voltage_v, least_v, most_v, steady = in_force(commands, time_s - law.latency_s, law.timing_s)
    of_off, of_rise = 1.0, 1.0
    if corrected:
        of_off, of_rise = correction_factors(
            log_f, log_n, log_s, volts, times, off_factor, gain_factor, time_factor,
            frequency_hz, voltage_v, normal_force_n, speed_m_s, time_s,
        )  # fmt: skip
    low = cof_one(axes, cof, frequency_hz, 0.0, normal_force_n)
    off_n = normal_force_n * of_off * low
    per_rise_n = normal_force_n * of_rise
    rise_n = per_rise_n * (cof_one(axes, cof, frequency_hz, voltage_v, normal_force_n) - low)
    spread_n = per_rise_n * (
        cof_one(axes, cof, frequency_hz, most_v, normal_force_n)
        - cof_one(axes, cof, frequency_hz, least_v, normal_force_n)
    )
    lagged_off_n, lagged_rise_n = off_n, 0.0
    if not np.isnan(known.expected_off_n):
        share = -np.expm1(-2.0 * np.pi * law.cutoff_hz_per_m_s * speed_m_s * elapsed_s)
        lagged_off_n = known.expected_off_n + share * (off_n - known.expected_off_n)
        lagged_rise_n = known.expected_rise_n + share * (rise_n - known.expected_rise_n)
    if lagged_rise_n < LEAST_FORCE_N:  # what decays for ever would get too small to be computed fast
        lagged_rise_n = 0.0
    return lagged_off_n, lagged_rise_n, spread_n, steady


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _time_constant_s(law: FeedbackSettings, deviation: float) -> float:
    """Shorter, down to `timing_s`, the less is known: `deviation` of the friction expected, as a share of it."""
    settled = law.deviation * np.sqrt(law.time_constant_s / law.memory_s)
    return float(max(law.timing_s, law.time_constant_s * min(settled / deviation, 1.0)))


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _forgotten(known: Estimate, law: FeedbackSettings, share: float, time_s: float) -> Estimate:
    """Without contact what is known goes back to what is known of any finger: the next may be another's."""
    prior = law.deviation**2
    return Estimate(
        known.off_gain + share * (1.0 - known.off_gain),
        known.rise_gain + share * (1.0 - known.rise_gain),
        known.off_variance + share * (prior - known.off_variance),
        known.covariance + share * (law.correlation * prior - known.covariance),
        known.rise_variance + share * (prior - known.rise_variance),
        known.gain + share * (1.0 - known.gain),
        0.0, 0.0, 0.0, np.nan, np.nan,
        time_s if np.isfinite(time_s) else known.time_s,
        known.reading_time_s, np.nan, np.nan, 0.0,
    )  # fmt: skip


@numba.njit(cache=True, nogil=True, error_model="numpy")
def in_force(commands: Array, at_s: float, around_s: float) -> tuple[float, float, float, float, bool]:
    """Frequency and voltage in force at a time, lowest and highest voltage around it, and whether one carrier held.

    `commands` as for `learn`; before the oldest of them, where that is known, there was no voltage. Where nobody knows
    the voltage (NaN) none is taken, and no carrier held.
    """
    voltage_v, frequency_hz, found = 0.0, SOME_FREQUENCY_HZ, False
    least_v, most_v = np.inf, 0.0
    carrier_hz, steady = np.nan, True
    for k in range(commands.shape[1]):
        began_s, command_hz, peak_v = commands[0, k], commands[1, k], commands[2, k]
        if began_s > at_s + around_s:
            continue
        first_ever = np.isnan(began_s)
        if first_ever:
            peak_v = 0.0
        elif np.isnan(peak_v):
            peak_v, steady = 0.0, False
        least_v, most_v = min(least_v, peak_v), max(most_v, peak_v)
        if peak_v > 0.0:
            steady = steady and not (carrier_hz != command_hz and carrier_hz > 0.0)
            carrier_hz = command_hz
        if not found and (first_ever or began_s <= at_s):
            found, voltage_v = True, peak_v
            frequency_hz = command_hz if peak_v > 0.0 else SOME_FREQUENCY_HZ
        if first_ever or began_s <= at_s - around_s:
            break
    if voltage_v == 0.0 and carrier_hz > 0.0:
        frequency_hz = carrier_hz
    return frequency_hz, voltage_v, min(least_v, voltage_v), most_v, steady and found


@numba.njit(cache=True, nogil=True, error_model="numpy")
def control(
    axes: Array, cof: Array, current: Array, stuck: Array, limit: Array, highest: Array,
    log_f: Array, log_n: Array, log_s: Array, volts: Array, times: Array,
    off_factor: Array, gain_factor: Array, time_factor: Array,
    how: Array, law: Array, known: Array, commands: Array, then_known: Array, then_commands: Array,
    target_cof: float, time_s: float, speed_m_s: float, normal_force_n: float, lateral_force_n: float,
    in_contact: bool, applied_hz: float, applied_v: float, present_hz: float,
) -> tuple[float, float, float, float, float, float, float]:  # fmt: skip
    """`learn`, unless `law` is empty, then `choose`: in one call, which costs as much as either does.

    `how`: the arguments of `choose` from `corrected` to `margin` in a row. NaN for a target that is none, or under a
    finger that does not press.
    """
    corrected, first, stop, merit = how[0] > 0.0, int(how[1]), int(how[2]), int(how[3])
    fixed_hz, hysteresis, voltage_cap, current_cap, margin = how[4], how[5], how[6], how[7], how[8]
    if law.size > 0:
        learn(
            axes, cof, log_f, log_n, log_s, volts, times, off_factor, gain_factor, time_factor, corrected,
            law, known, commands, then_known, then_commands,
            time_s, speed_m_s, normal_force_n, lateral_force_n, in_contact, applied_hz, applied_v,
        )  # fmt: skip
    if not target_cof > 0.0 or not normal_force_n > 0.0:
        return np.nan, np.nan, np.nan, np.nan, np.nan, np.nan, np.nan
    return choose(
        axes, cof, current, stuck, limit, highest,
        log_f, log_n, log_s, volts, times, off_factor, gain_factor, time_factor, corrected,
        first, stop, merit, fixed_hz, hysteresis, voltage_cap, current_cap,
        then_known if law.size > 0 else known, margin, target_cof, normal_force_n, speed_m_s, time_s, present_hz,
    )  # fmt: skip
