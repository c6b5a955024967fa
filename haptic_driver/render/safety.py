"""The last gate: an operating point inside every limit passes unchanged, any other becomes zero volts and a reason.

Nothing is clamped here: a point outside the limits means that a stage before is wrong. The rules are those of
`haptic_driver.limits`, written out again for one point, so that a mistake there does not pass unseen.
"""

from __future__ import annotations

from bisect import bisect_right
from math import exp, isfinite, log, pi, sqrt
from operator import itemgetter
from typing import NamedTuple

from haptic_driver.limits import OperatingLimits
from haptic_driver.render.compiled import kernel
from haptic_driver.signals import Array, OperatingPoint, SafeOperatingPoint

_FREQUENCY = itemgetter(0)  # of a point of the limit curve


class SafetyState(NamedTuple):
    """How often a point was rejected, and why the last time; sticky."""

    rejections: int
    last_reason: str | None


INITIAL = SafetyState(0, None)


def gate(limits: OperatingLimits, state: SafetyState, point: OperatingPoint) -> tuple[SafetyState, SafeOperatingPoint]:
    """`point` itself if it is safe, else zero volts with the reason."""
    reason = violation(limits, point)
    if reason is None:
        return state, SafeOperatingPoint(point.frequency_hz, point.voltage_v, None)
    return SafetyState(state.rejections + 1, reason), SafeOperatingPoint(point.frequency_hz, 0.0, reason)


def violation(limits: OperatingLimits, point: OperatingPoint) -> str | None:  # noqa: PLR0911 (one per limit)
    """Why a point is refused, in words; None when it is inside every limit."""
    f, v = point.frequency_hz, point.voltage_v
    sliding, stuck = point.current_rms_a, point.stuck_current_rms_a
    if not isfinite(f + v + sliding + stuck):  # each of them, then
        return "the operating point is not finite"
    if v == 0.0:
        return None
    if not limits.frequency_low_hz <= f <= limits.frequency_high_hz:
        return f"{f:g} Hz is outside {limits.frequency_low_hz:g}..{limits.frequency_high_hz:g} Hz"
    if not 0.0 < v <= limits.voltage_v:
        return f"{v:g} V is outside 0..{limits.voltage_v:g} V peak at the electrode"
    slew = 2.0 * pi * f * v
    if slew > limits.slew_v_per_s:
        return f"slew {slew:.3g} V/s exceeds {limits.slew_v_per_s:.3g} V/s"
    panel = slew * limits.panel_capacitance_f
    if panel > limits.amplifier_current_a:
        return f"panel current {panel:.3g} A exceeds {limits.amplifier_current_a:.3g} A peak"
    allowed = contact_current_limit_a_rms(limits, f)
    if sliding < 0.0 or sliding > allowed:
        return f"finger current {sliding:.3g} A rms exceeds {allowed:.3g} A rms at {f:g} Hz"
    deliverable = limits.amplifier_current_a / sqrt(2.0)
    if limits.series_resistance_ohm > 0.0:
        deliverable = min(deliverable, v / (sqrt(2.0) * limits.series_resistance_ohm))
    if stuck < 0.0 or min(stuck, deliverable) > allowed:
        return f"worst-case finger current {min(stuck, deliverable):.3g} A rms exceeds {allowed:.3g} A rms at {f:g} Hz"
    return None


def gate_envelope(
    limits: OperatingLimits, state: SafetyState, peak: OperatingPoint, voltage_v: Array
) -> tuple[SafetyState, bool]:
    """Whether peak voltages [n] are refused, as a whole: for their highest, or for one that is beyond it.

    Every limit is one on voltage at the carrier's frequency, or grows with it, so what is below a safe point is safe.
    """
    reason = violation(limits, peak)
    if reason is None:
        beyond = first_beyond(voltage_v, peak.voltage_v)
        if beyond < 0:
            return state, False
        said = f"point {beyond} of the envelope, {voltage_v[beyond]:g} V"
        reason = f"{said}, is outside 0..{peak.voltage_v:g} V"
    return SafetyState(state.rejections + 1, reason), True


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
