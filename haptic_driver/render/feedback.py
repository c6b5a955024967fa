"""Feedback from measured friction: what this finger's friction is compared with the surface's.

The surface says what friction a typical finger feels; this finger feels

    cof = off_gain * friction without voltage + rise_gain * rise through attraction.

Both gains are estimated while the finger slides, and the controller inverts the surface through
them. The loop is feed-forward through an estimated plant, so that voltage and carrier stay those of
the surface and of its limits.

The law, per new reading of the force sensor, has two lateral forces h. The surface alone gives them
for the command in force `latency_s` ago, and they are lagged as friction lags. P is the covariance
of the gains x,

    x <- x + s P h (F - x.h) / (h.P h),    P <- P - s P h h^T P / (h.P h) + f (P0 - P),

s = 1 - exp(-dt/T), f = 1 - exp(-dt/memory_s), x kept within bounds. T is `time_constant_s` once the
finger is known, and down to `timing_s` for an unknown finger. It is the projection algorithm
(Goodwin and Sin, Adaptive Filtering Prediction and Control, 1984, ch. 3) in a metric that learns:
the error of x never grows, measured by P. Since P is drawn to P0, it neither winds up nor dies. The
command takes part with its delay, so delay does not destabilise. With a latency wrong by e the
loop's gain is at most e/T, and it is stable below 1 (small gain). `timing_s` within which commands
differ slows learning down, to a stop where the output ramps.

The electrode's current shows the rise alone, never friction without voltage. Where it stands in
for a force sensor, `off_share` is 0, and without voltage nothing is learnt.

Nothing is learnt while the finger is off, rests or has just set out. Nothing is learnt while force
is unknown (NaN: stale, saturated) or unchanged, or until a change of the carrier shows in friction.
The same holds while the output comes on and its voltage is unknown (NaN). A target out of reach
cannot wind anything up. Friction is compared with what the commanded voltage should give, not with
the target. Learning goes on there, or a gain believed too small would never be found out.

On another carrier attraction is another. There the rise is assumed to differ from the usual by the
same factor as friction without voltage. Its uncertainty is that of an unknown finger; both the more
so, the farther away the carrier.
"""

from __future__ import annotations

from math import inf, isfinite, nan
from typing import NamedTuple

import numpy as np

from haptic_driver.errors import BadInputError
from haptic_driver.render.compiled import kernel
from haptic_driver.render.correction import Correction, factors_at
from haptic_driver.render.surface import Surface, as_solved, at_node, at_voltage, between, place_of
from haptic_driver.signals import Array, DriveCommand, FingerState

COMMANDS_KEPT = 128
LONGEST_LATENCY_S = 0.1  # so far so many commands reach back, at 1 kHz
LEAST_FORCE_N = 1e-9
LARGEST_SURPRISE = 0.5  # of the force expected; more is an outlier and counts as so much
RAMP = 0.5  # of the change that commands make within the timing window: error of what is expected
LEAST_PACE = 0.1  # slower is a standstill: the output ramps
LONGEST_STEP_S = 0.010  # no reading teaches more than so much time would
RATE_TIME_CONSTANT_S = 0.5
# factors of e by which the carrier changes until most is forgotten of the rise
CARRIER_MEMORY = 1.0
PATIENCE_S = 1.0  # without a reading for so long there is no feedback to be careful for
SOME_FREQUENCY_HZ = 1e3  # for a look-up at zero voltage, where it does not matter
NO_COMMANDS = np.full((COMMANDS_KEPT, 3), nan)

# h of the law: lateral ones by the surface alone, without voltage and by attraction
Forces = tuple[float, float]


class FeedbackSettings(NamedTuple):
    """How the finger's gains are learnt.

    `latency_s`: from a command until the force sensor reports its effect; `timing_s`: by how much
    that may be off. `time_constant_s` of learning, once the finger is known; `memory_s`: how fast
    what was learnt may become wrong. `deviation` and `correlation` of the two gains from finger to
    finger, before anything was measured. `lowest_gain`, `highest_gain`: bounds. `slowest_m_s`,
    `settled_m`: slower, and before that way in one stroke, nothing is learnt. `cutoff_hz_per_m_s`:
    friction follows voltage with a first-order lag of that cut-off per speed (13.8 Hz per mm/s,
    arXiv 2505.11162). `caution` weighs the variance of the friction against the squared error
    expected. It is above 1, since rising friction is felt more strongly than falling
    (10.1109/TOH.2018.2830790, abstract). `off_share`: of `deviation`, for friction without voltage;
    0 where nothing shows that, which leaves its gain at 1.
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
    caution: float = 4.0
    off_share: float = 1.0


class Gains(NamedTuple):
    """cof = `off` x friction without voltage + `rise` x rise by attraction: x of the law; and P,
    their covariance.
    """

    off: float = 1.0
    rise: float = 1.0
    off_variance: float = 0.0
    covariance: float = 0.0
    rise_variance: float = 0.0


class Estimate(NamedTuple):
    """What is known of the finger; by default that it is the one that the surface was made for.

    `gain` is what both gains make of the friction at the present drive, `gain_rate_per_s` its
    drift, smoothed. `learning`: the last sample taught something; `at_limit`: a gain stands at its
    bound; `cautious`: a force was measured lately, so that the covariance counts. `expected_off_n`
    and `expected_rise_n`: lateral force by the surface alone, lagged as friction lags; NaN without
    contact. `time_s` and `normal_force_n` are the last sample's, `reading_time_s` and
    `lateral_force_n` the last new reading's; `slid_m` is the way of this stroke. `contact_area_m2`
    is the last sample's, NaN where it is unknown.
    """

    gains: Gains = Gains()
    gain: float = 1.0
    gain_rate_per_s: float = 0.0
    learning: bool = False
    at_limit: bool = False
    cautious: bool = False
    expected_off_n: float = nan
    expected_rise_n: float = nan
    time_s: float = nan
    reading_time_s: float = -inf
    normal_force_n: float = nan
    lateral_force_n: float = nan
    slid_m: float = 0.0
    contact_area_m2: float = nan


class InForce(NamedTuple):
    """The command in force at a time, the least and the most voltage around it, and whether one
    carrier held.
    """

    frequency_hz: float
    voltage_v: float
    least_v: float
    most_v: float
    steady: bool


def checked(law: FeedbackSettings) -> FeedbackSettings:
    """`law` itself, in floats. Raises BadInputError for settings that have no meaning."""
    wrong = [
        name for name, value in law._asdict().items() if not (isfinite(value) and value >= 0.0)
    ]
    if wrong:
        said, hint = (
            f"feedback {wrong[0]} is {getattr(law, wrong[0])}",
            "give a finite number, 0 or more",
        )
    elif law.latency_s + law.timing_s > LONGEST_LATENCY_S:
        said = f"feedback over a latency of {law.latency_s:g} s is too late"
        hint = f"give at most {LONGEST_LATENCY_S:g} s, timing included, or switch feedback off"
    elif not (
        law.timing_s < law.time_constant_s < law.memory_s
        and 0.0 < law.lowest_gain < 1.0 < law.highest_gain
        and law.correlation < 1.0
        and law.deviation > 0.0
    ):
        said = f"feedback settings contradict one another: {law}"
        hint = (
            "choose timing_s < time_constant_s < memory_s, 0 < lowest_gain < 1 < highest_gain,"
            " correlation < 1"
        )
    else:
        return FeedbackSettings(*map(float, law))
    raise BadInputError("bad_feedback", said, hint)


@kernel
def remembered(commands: Array, time_s: float, applied: DriveCommand) -> Array:
    """Commands [n, 3] of time, frequency and voltage, newest first, with one more; NaN where there
    was none yet.

    The voltage is NaN of a command that is on its way while the output comes on.
    """
    then = np.empty_like(commands)
    then[1:] = commands[:-1]
    then[0, 0], then[0, 1], then[0, 2] = time_s, applied.frequency_hz, applied.voltage_v
    return then


@kernel
def learnt(
    surface: Surface,
    correction: Correction,
    law: FeedbackSettings,
    known: Estimate,
    then: InForce,
    finger: FingerState,
) -> Estimate:
    """The state after one more sample of the finger, with command `then` in force; the module's
    docstring has the law.
    """
    elapsed_s = finger.time_s - known.time_s
    # the first sample, one without a time, or a clock that began again
    if not 0.0 <= elapsed_s < np.inf:
        elapsed_s = 0.0
    gains = any_finger(law) if np.isnan(known.time_s) else known.gains
    if not finger.in_contact:
        return forgotten(law, known, gains, elapsed_s, finger.time_s)
    felt, spread_n = by_surface(surface, correction, then, finger)
    speed_m_s = np.hypot(finger.velocity_x_m_s, finger.velocity_y_m_s)
    h = off_n, rise_n = lagged(law, known, felt, speed_m_s * elapsed_s)
    slid_m = known.slid_m + speed_m_s * elapsed_s if speed_m_s >= law.slowest_m_s else 0.0
    repeated = (
        finger.lateral_force_n == known.lateral_force_n
        and finger.normal_force_n == known.normal_force_n
    )
    new = bool(np.isfinite(finger.lateral_force_n) and not repeated)
    reading_s = finger.time_s if new else known.reading_time_s
    lateral_n = finger.lateral_force_n if new else known.lateral_force_n
    _, _, variance = spread(gains, h)
    told = then.steady and variance > 0.0
    pace = variance / (variance + (RAMP * gains.rise * spread_n) ** 2) if told else 0.0
    learning = new and slid_m >= law.settled_m and pace >= LEAST_PACE
    gain, rate, at_limit = known.gain, known.gain_rate_per_s, known.at_limit
    if learning:
        since_s = finger.time_s - known.reading_time_s
        worth_s = pace * min(since_s if since_s >= 0.0 else elapsed_s, LONGEST_STEP_S)
        gains, at_limit = taught(law, gains, h, finger.lateral_force_n, worth_s)
        gain = (gains.off * off_n + gains.rise * rise_n) / (off_n + rise_n)
        if elapsed_s > 0.0:
            rate += -np.expm1(-elapsed_s / RATE_TIME_CONSTANT_S) * (
                (gain - known.gain) / elapsed_s - rate
            )
    time_s, load_n, cautious = (
        finger.time_s,
        finger.normal_force_n,
        finger.time_s - reading_s < PATIENCE_S,
    )
    return Estimate(
        gains,
        gain,
        rate,
        learning,
        at_limit,
        cautious,
        off_n,
        rise_n,
        time_s,
        reading_s,
        load_n,
        lateral_n,
        slid_m,
        finger.contact_area_m2,
    )


@kernel
def taught(
    law: FeedbackSettings, gains: Gains, h: Forces, lateral_n: float, worth_s: float
) -> tuple[Gains, bool]:
    """The gains after one reading that is worth so much time, and whether one of them stands at its
    bound.
    """
    (off_n, rise_n), (ph_off, ph_rise, hph) = h, spread(gains, h)
    expected_n = gains.off * off_n + gains.rise * rise_n
    share = -np.expm1(-worth_s / time_constant_s(law, np.sqrt(hph) / expected_n))
    bound_n = LARGEST_SURPRISE * expected_n
    step = share * min(max(abs(lateral_n) - expected_n, -bound_n), bound_n) / hph
    off, rise = gains.off + step * ph_off, gains.rise + step * ph_rise
    bounded_off = min(max(off, law.lowest_gain), law.highest_gain)
    bounded_rise = min(max(rise, law.lowest_gain), law.highest_gain)
    _, _, p, q, r = drawn(gains, any_finger(law), -np.expm1(-worth_s / law.memory_s))
    p -= share * ph_off * ph_off / hph
    q -= share * ph_off * ph_rise / hph
    r -= share * ph_rise * ph_rise / hph
    return Gains(bounded_off, bounded_rise, p, q, r), bounded_off != off or bounded_rise != rise


@kernel
def time_constant_s(law: FeedbackSettings, deviation: float) -> float:
    """Shorter, down to `timing_s`, the less is known: `deviation` of the friction expected, as a
    share of it.
    """
    settled = law.deviation * np.sqrt(law.time_constant_s / law.memory_s)
    return float(max(law.timing_s, law.time_constant_s * min(settled / deviation, 1.0)))


@kernel
def spread(gains: Gains, h: Forces) -> tuple[float, float, float]:
    """P h, and h.P h: the variance of the force expected."""
    off_n, rise_n = h
    ph_off = gains.off_variance * off_n + gains.covariance * rise_n
    ph_rise = gains.covariance * off_n + gains.rise_variance * rise_n
    return ph_off, ph_rise, off_n * ph_off + rise_n * ph_rise


@kernel
def any_finger(law: FeedbackSettings) -> Gains:
    """What is known of a finger of which nothing was measured: P0."""
    variance, share = law.deviation**2, law.off_share
    return Gains(1.0, 1.0, share**2 * variance, share * law.correlation * variance, variance)


@kernel
def drawn(gains: Gains, to: Gains, share: float) -> Gains:
    """Some share of the way from one to the other."""
    return Gains(
        between(gains.off, to.off, share),
        between(gains.rise, to.rise, share),
        between(gains.off_variance, to.off_variance, share),
        between(gains.covariance, to.covariance, share),
        between(gains.rise_variance, to.rise_variance, share),
    )


@kernel
def forgotten(
    law: FeedbackSettings, known: Estimate, gains: Gains, elapsed_s: float, time_s: float
) -> Estimate:
    """Without contact what is known goes back to what is known of any finger: the next may be
    another's.
    """
    share = -np.expm1(-elapsed_s / law.memory_s)
    faded, gain = drawn(gains, any_finger(law), share), between(known.gain, 1.0, share)
    last_s, reading_s = time_s if np.isfinite(time_s) else known.time_s, known.reading_time_s
    cautious = time_s - reading_s < PATIENCE_S
    return Estimate(
        faded, gain, 0.0, False, False, cautious, nan, nan, last_s, reading_s, nan, nan, 0.0, nan
    )


@kernel
def elsewhere(law: FeedbackSettings, known: Estimate, from_hz: float, to_hz: float) -> Estimate:
    """The same finger on another carrier."""
    g = known.gains
    other = Gains(g.off, g.off, g.off_variance, g.off_variance, g.off_variance + law.deviation**2)
    share = -np.expm1(-abs(np.log(to_hz / from_hz)) / CARRIER_MEMORY)
    return with_gains(known, drawn(g, other, share), known.expected_off_n, known.expected_rise_n)


@kernel
def rescaled(known: Estimate, off: float, rise: float, level: float, share: float) -> Estimate:
    """The same finger on another surface, whose friction without voltage and whose rise are that
    many times less.

    Both gains are `level` then, and of their covariance in newtons that `share` is kept.
    """
    g = known.gains
    gains = Gains(
        level,
        level,
        share * g.off_variance * off * off,
        share * g.covariance * off * rise,
        share * g.rise_variance * rise * rise,
    )
    return with_gains(known, gains, known.expected_off_n / off, known.expected_rise_n / rise)


@kernel
def with_gains(known: Estimate, gains: Gains, off_n: float, rise_n: float) -> Estimate:
    """The same with other gains, and other forces by the surface alone."""
    return Estimate(
        gains,
        known.gain,
        known.gain_rate_per_s,
        known.learning,
        known.at_limit,
        known.cautious,
        off_n,
        rise_n,
        known.time_s,
        known.reading_time_s,
        known.normal_force_n,
        known.lateral_force_n,
        known.slid_m,
        known.contact_area_m2,
    )


@kernel
def by_surface(
    surface: Surface, correction: Correction, then: InForce, finger: FingerState
) -> tuple[Forces, float]:
    """What the surface alone gives for a command, and how much the voltages around it change of
    that.
    """
    solved = as_solved(surface, finger)
    factors = factors_at(correction, then.frequency_hz, then.voltage_v, solved)
    place = place_of(surface, then.frequency_hz, solved.normal_force_n)
    low = at_node(surface.cof, place, 0)
    off_n, per_rise_n = (
        finger.normal_force_n * factors.off * low,
        finger.normal_force_n * factors.rise,
    )
    rise = at_voltage(surface, surface.cof, place, then.voltage_v) - low
    most = at_voltage(surface, surface.cof, place, then.most_v)
    least = at_voltage(surface, surface.cof, place, then.least_v)
    return (off_n, per_rise_n * rise), per_rise_n * (most - least)


@kernel
def lagged(law: FeedbackSettings, known: Estimate, felt: Forces, way_m: float) -> Forces:
    """Friction follows voltage with a first-order lag of the way; at the touch there is no
    attraction yet.
    """
    off_n, rise_n = felt
    if np.isnan(known.expected_off_n):
        return off_n, 0.0
    share = -np.expm1(-2.0 * np.pi * law.cutoff_hz_per_m_s * way_m)
    rise_n = between(known.expected_rise_n, rise_n, share)
    if rise_n < LEAST_FORCE_N:  # what decays for ever would get too small to be computed fast
        rise_n = 0.0
    return between(known.expected_off_n, off_n, share), rise_n


@kernel
def in_force(commands: Array, at_s: float, around_s: float) -> InForce:
    """What was in force at a time and around it, by the commands that `remembered` has kept.

    Before the oldest command, where that is known, there was no voltage. Where nobody knows the
    voltage (NaN) none is taken, and no carrier held.
    """
    voltage_v, frequency_hz, found = 0.0, SOME_FREQUENCY_HZ, False
    least_v, most_v = np.inf, 0.0
    carrier_hz, steady = np.nan, True
    for k in range(commands.shape[0]):
        began_s, command_hz, peak_v = commands[k, 0], commands[k, 1], commands[k, 2]
        if began_s > at_s + around_s:
            if peak_v > 0.0 and np.isnan(carrier_hz):
                carrier_hz = command_hz
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
    return InForce(frequency_hz, voltage_v, min(least_v, voltage_v), most_v, steady and found)
