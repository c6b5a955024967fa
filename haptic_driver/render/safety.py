"""The last gate: an operating point inside every limit passes unchanged, any other becomes zero
volts and a reason.

Nothing is clamped here: a point outside the limits means that a stage before is wrong. The rules
are those of `haptic_driver.limits`, written out again for one point, so that a mistake there does
not pass unseen. What finger and electrode get at worst the gate looks up by itself, in a table of
its own.
"""

from __future__ import annotations

from bisect import bisect_right
from math import exp, isfinite, log, pi, sqrt
from operator import itemgetter
from typing import NamedTuple

import numpy as np

from haptic_driver.base.units import readable
from haptic_driver.limits import OperatingLimits, WorstCase
from haptic_driver.render.compiled import kernel
from haptic_driver.signals import Array, OperatingPoint, SafeOperatingPoint

ON_NODE = 1e-9  # of a cell: so near to a node is the node
TINY = 1e-300  # stands for 0 in logarithms
_FREQUENCY = itemgetter(0)  # of a point of the limit curve


class Worst(NamedTuple):
    """What finger (A rms) and electrode (peak) may get of one point, by the model."""

    stuck_current_rms_a: float
    electrode_voltage_v: float


class WorstTable(NamedTuple):
    """`WorstCase` as compiled code reads it: nodes [f] and [v], values [f, v - 1]."""

    log_frequency: Array
    voltage_v: Array
    stuck_current_a_per_v: Array
    electrode_gain: Array


def table_of(worst: WorstCase) -> WorstTable:
    """The gate's own table."""
    values = map(np.ascontiguousarray, (worst.stuck_current_a_per_v, worst.electrode_gain))
    return WorstTable(np.log(worst.frequency_hz), worst.voltage_v, *values)


class SafetyState(NamedTuple):
    """How often a point was rejected."""

    rejections: int


INITIAL = SafetyState(0)


def gate(
    limits: OperatingLimits, state: SafetyState, point: OperatingPoint, worst: Worst
) -> tuple[SafetyState, SafeOperatingPoint]:
    """`point` itself if it is safe, else zero volts with the reason."""
    reason = violation(limits, point, worst)
    if reason is None:
        return state, SafeOperatingPoint(point.frequency_hz, point.voltage_v, None)
    return SafetyState(state.rejections + 1), SafeOperatingPoint(point.frequency_hz, 0.0, reason)


def violation(limits: OperatingLimits, point: OperatingPoint, worst: Worst) -> str | None:  # noqa: PLR0911 (one per limit)
    """Why a point is refused, in words; None when it is inside every limit.

    Of what the point claims and what `worst` says the larger counts.
    """
    f, v, sliding = point.frequency_hz, point.voltage_v, point.current_rms_a
    if not isfinite(f + v + sliding + point.stuck_current_rms_a):  # each of them, then
        return "the operating point is not finite"
    if v == 0.0:
        return None
    if not limits.frequency_low_hz <= f <= limits.frequency_high_hz:
        return f"{f:g} Hz is outside {limits.frequency_low_hz:g}..{limits.frequency_high_hz:g} Hz"
    if not isfinite(worst.stuck_current_rms_a + worst.electrode_voltage_v):
        return f"nobody knows what {v:g} V at {f:g} Hz do at worst"
    electrode_v = max(v, worst.electrode_voltage_v)
    if not 0.0 < v <= electrode_v <= limits.voltage_v:
        return f"{electrode_v:g} V is outside 0..{limits.voltage_v:g} V peak at the electrode"
    slew = 2.0 * pi * f * electrode_v
    if slew > limits.slew_v_per_s:
        return f"slew {readable(slew, 'V/s')} exceeds {readable(limits.slew_v_per_s, 'V/s')}"
    panel = slew * limits.panel_capacitance_f
    if panel > limits.amplifier_current_a:
        return (
            f"panel current {readable(panel, 'A')} exceeds"
            f" {readable(limits.amplifier_current_a, 'A')} peak"
        )
    allowed = contact_current_limit_a_rms(limits, f)
    if sliding < 0.0 or sliding > allowed:
        return (
            f"finger current {readable(sliding, 'A rms')} exceeds"
            f" {readable(allowed, 'A rms')} at {f:g} Hz"
        )
    deliverable = limits.amplifier_current_a / sqrt(2.0)
    if limits.series_resistance_ohm > 0.0:
        deliverable = min(deliverable, electrode_v / (sqrt(2.0) * limits.series_resistance_ohm))
    stuck = min(max(point.stuck_current_rms_a, worst.stuck_current_rms_a), deliverable)
    if point.stuck_current_rms_a < 0.0 or stuck > allowed:
        return (
            f"worst-case finger current {readable(stuck, 'A rms')} exceeds"
            f" {readable(allowed, 'A rms')} at {f:g} Hz"
        )
    return None


def gate_envelope(
    limits: OperatingLimits,
    state: SafetyState,
    peak: OperatingPoint,
    worst: Worst,
    voltage_v: Array,
) -> tuple[SafetyState, bool]:
    """Whether peak voltages [n] are refused, as a whole: for their highest, or for one that is
    beyond it.

    `worst` is that of any voltage up to the peak, so what is below a safe point is safe.
    """
    if violation(limits, peak, worst) is None and first_beyond(voltage_v, peak.voltage_v) < 0:
        return state, False
    return SafetyState(state.rejections + 1), True


@kernel
def worst_at(table: WorstTable, frequency_hz: float, voltage_v: float) -> tuple[float, float]:
    """The fields of `Worst`, of all voltages up to this one; infinite where the table ends."""
    nodes, volts = table.log_frequency, table.voltage_v
    place = (np.log(frequency_hz) - nodes[0]) / (nodes[-1] - nodes[0]) * (nodes.size - 1)
    if not -ON_NODE < place < nodes.size - 1 + ON_NODE:
        return np.inf, np.inf
    i, a = int(place + 0.5), 0.0
    if abs(place - i) >= ON_NODE:
        i = int(place)
        a = place - i
    stuck_a, electrode_v = 0.0, 0.0
    for k in range(volts.size - 1):
        up_to_v = min(volts[k + 1], voltage_v)
        stuck_a = max(stuck_a, up_to_v * per_volt(table.stuck_current_a_per_v, i, a, k))
        electrode_v = max(electrode_v, up_to_v * per_volt(table.electrode_gain, i, a, k))
        if volts[k + 1] >= voltage_v:
            return stuck_a, electrode_v
    return np.inf, np.inf


@kernel
def per_volt(values: Array, i: int, a: float, k: int) -> float:
    """A value at node `i` of frequency, or between it and the next.

    There it goes straight on logarithmic axes, and over that by as much as it bends: see
    `WorstCase.at`.
    """
    if a == 0.0:
        return float(values[i, k])
    bend = 0.0
    for m in (i, i + 1):
        if 0 < m < values.shape[0] - 1:
            bend += max(
                2.0 * logarithm(values[m, k])
                - logarithm(values[m - 1, k])
                - logarithm(values[m + 1, k]),
                0.0,
            )
    straight = (1.0 - a) * logarithm(values[i, k]) + a * logarithm(values[i + 1, k])
    return float(np.exp(straight + 0.25 * bend))


@kernel
def logarithm(value: float) -> float:
    """Finite for 0 too."""
    return float(np.log(max(value, TINY)))


@kernel
def first_beyond(voltage_v: Array, most_v: float) -> int:
    """The first of voltages [n] that is not within 0..`most_v`, as NaN is not; -1 for none."""
    for i in range(voltage_v.size):
        if not 0.0 <= voltage_v[i] <= most_v:
            return i
    return -1


def contact_current_limit_a_rms(limits: OperatingLimits, frequency_hz: float) -> float:
    """The limit curve at one frequency: straight lines on logarithmic axes, held at the ends."""
    curve = limits.contact_current_a_rms
    i = bisect_right(curve, frequency_hz, key=_FREQUENCY)
    if i in (0, len(curve)):
        return curve[0][1] if i == 0 else curve[-1][1]
    (f0, i0), (f1, i1) = curve[i - 1], curve[i]
    share = log(frequency_hz / f0) / log(f1 / f0)
    return exp(log(i0) + share * log(i1 / i0))
