"""Target friction -> operating point: which frequency, then which voltage.

A policy (`policies.py`) says how the frequency is chosen; the voltage then follows from the
surface. The force pulses at twice the carrier, so no policy but `fixed_frequency` goes below
`lowest_carrier_hz`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import hypot, nan
from typing import Any, NamedTuple

import numpy as np
from numba import typed

from haptic_driver.limits import OperatingLimits, WorstCase
from haptic_driver.render import feedback
from haptic_driver.render.choice import Choice
from haptic_driver.render.compiled import either, kernel, laid_out
from haptic_driver.render.correction import NO_CORRECTION, Correction, Factors, factors_at
from haptic_driver.render.feedback import Estimate, FeedbackSettings, Gains, InForce
from haptic_driver.render.policies import chosen_by
from haptic_driver.render.surface import (
    NO_CAPS,
    ON_NODE,
    Caps,
    Inverse,
    Place,
    Surface,
    as_solved,
    at_voltage,
    between,
    cof_at,
    crossing_v,
    highest_cof,
    invert,
    invert_at,
    locate,
    place_of,
)
from haptic_driver.signals import Array, DriveCommand, FingerState, OperatingPoint, TargetFriction

IDLE_HZ = 10e3  # where the frequency does not matter
CLEAR = 1.0 - 1e-9  # of a limit: kept clear of it against rounding
CORRECTION_ROUNDS = 4
FREQUENCY_ROUNDS = 2  # of them choose the frequency too; later ones find the voltage alone
USUAL_SHARE = 0.5  # of the highest voltage, where there is none
LEAST_V = 1.0  # below, a voltage tells nothing of the rise


@dataclass(frozen=True)
class ControllerSettings:
    """A surface and how to use it.

    `policy`: the name of one of `policies.py`, which reads the next three. `hysteresis`: how much
    better (relative) another frequency must be before the carrier moves there. `correction`: what
    the finger's speed and the time do to friction, where the model says they do anything.
    `feedback`: how the finger's own gains are learnt from measured friction; None leaves them at 1.
    """

    surface: Surface
    limits: OperatingLimits
    policy: str = "max_authority"
    fixed_frequency_hz: float | None = None
    lowest_carrier_hz: float = 100.0
    quiet_above_hz: float = 1000.0
    hysteresis: float = 0.05
    correction: Correction | None = None
    feedback: FeedbackSettings | None = None

    def __post_init__(self) -> None:
        """Refuse settings under which no frequency could be chosen."""
        chosen_by(self)

    def caps(self, frequency_hz: float) -> Caps:
        """Largest voltage and sliding current that the limits allow at one frequency."""
        surface = self.surface
        frequencies_hz = np.exp(surface.log_frequency)
        worst = WorstCase(
            frequencies_hz, surface.voltage_v, surface.stuck_current_a_per_v, surface.electrode_gain
        )
        highest_v = self.limits.highest_within_v(worst.at(frequency_hz)).item()
        return Caps(
            CLEAR * highest_v, CLEAR * float(self.limits.contact_current_limit_a_rms(frequency_hz))
        )


class Control(NamedTuple):
    """The settings and tables that the compiled functions read.

    `highest` is `highest_cof` of the surface. `caps` belong to the frequency that `choice` fixes,
    if it fixes one.
    """

    surface: Surface
    highest: Array
    correction: Correction
    corrected: bool
    law: FeedbackSettings
    learns: bool
    choice: Choice
    hysteresis: float
    caps: Caps


class ControllerState(NamedTuple):
    """The frequency in use, NaN before the first target; what is known of the finger, and the last
    commands.
    """

    frequency_hz: float = nan
    estimate: Estimate = Estimate()
    commands: Array = feedback.NO_COMMANDS


INITIAL = ControllerState()
# numba's list of one: to hand over so many fields at each call costs more than the call does
Held = Sequence[Control]
Plain = tuple[Any, ...]  # the values of a record


class Controller:
    """The stage with everything that depends on settings alone worked out once. Raises
    BadInputError.

    Its methods are the compiled functions of these names, bound to `held`. They take and return
    records, which go in and out of compiled code as plain tuples. numba takes five times as long to
    recognise a record.
    """

    def __init__(self, settings: ControllerSettings) -> None:
        self.settings = settings
        correction, law = settings.correction, settings.feedback
        rank, *numbers = chosen_by(settings)
        choice = Choice(laid_out(rank), *map(float, numbers))
        surface = Surface(*map(laid_out, settings.surface))
        control = Control(
            surface=surface,
            highest=highest_cof(surface),
            correction=Correction(
                *map(laid_out, NO_CORRECTION if correction is None else correction)
            ),
            corrected=correction is not None,
            law=FeedbackSettings(0.0) if law is None else feedback.checked(law),
            learns=law is not None,
            choice=choice,
            hysteresis=float(settings.hysteresis),
            caps=NO_CAPS if np.isnan(choice.fixed_hz) else settings.caps(choice.fixed_hz),
        )
        self.held = hold(control)
        self._most_n = float(np.exp(surface.log_normal_force[-1])) * (1.0 + ON_NODE)
        pressures = surface.log_pressure
        self._most_pa = float(np.exp(pressures[-1])) * (1.0 + ON_NODE) if pressures.size else np.inf
        self._most_m_s = np.inf if correction is None else float(np.exp(correction.log_speed[-1]))

    def knows(self, finger: FingerState) -> bool:
        """Whether the surface was solved for so much load and speed; beyond, the nearest that it
        knows is taken.
        """
        speed_m_s = hypot(finger.velocity_x_m_s, finger.velocity_y_m_s)
        load_n, area_m2 = finger.normal_force_n, finger.contact_area_m2
        is_light = load_n <= (self._most_pa * area_m2 if area_m2 > 0.0 else self._most_n)
        return is_light and speed_m_s <= self._most_m_s

    def step(
        self,
        state: ControllerState,
        target: TargetFriction,
        finger: FingerState,
        applied: DriveCommand,
    ) -> tuple[ControllerState, OperatingPoint]:
        """See the compiled function."""
        after, point = step(self.held, plain(state), target[:], finger[:], applied[:])
        return recorded(after), OperatingPoint._make(point)

    def along(
        self, known: Estimate, target_cof: Array, finger: FingerState, frequency_hz: float
    ) -> tuple[Array, OperatingPoint]:
        """See the compiled function."""
        held, gains, cautious = self.held, known.gains[:], known.cautious
        voltage_v, peak = along(held, gains, cautious, target_cof, finger[:], frequency_hz)
        return voltage_v, OperatingPoint._make(peak)

    def carried(
        self,
        before: Controller,
        state: ControllerState,
        speed_m_s: float,
        contact_s: float,
        voltage_v: float,
    ) -> ControllerState:
        """See the compiled function."""
        return carried(self.held, before.held, plain(state), speed_m_s, contact_s, voltage_v)

    def full_scale_v(self, frequency_hz: float) -> float:
        """The most that any load may get at one frequency: that of a carrier whose amplitude
        something else makes.
        """
        return self.settings.caps(frequency_hz).voltage_v

    def reachable(self, normal_force_n: float) -> tuple[float, float]:
        """See the compiled function."""
        return reachable(self.held, normal_force_n)

    def current_a(self, frequency_hz: float, voltage_v: float, normal_force_n: float) -> float:
        """See the compiled function."""
        return current_a(self.held, frequency_hz, voltage_v, normal_force_n)

    def __reduce__(self) -> tuple[type[Controller], tuple[ControllerSettings]]:
        """Another process works it out again: what numba holds cannot be sent."""
        return Controller, (self.settings,)


@kernel
def hold(control: Control) -> Held:
    """The record as its compiled functions get it."""
    held: list[Control] = typed.List()
    held.append(control)
    return held


@either
def plain(state: ControllerState) -> Plain:
    """The values of a state and of the records in it."""
    return state.frequency_hz, state.estimate.gains[:], state.estimate[1:], state.commands


@either
def recorded(state: Plain) -> ControllerState:
    """The state whose values these are."""
    frequency_hz, gains, known, commands = state
    return ControllerState(frequency_hz, Estimate(Gains(*gains), *known), commands)


@kernel
def step(
    held: Held, state: Plain, target: Plain, finger: Plain, applied: Plain
) -> tuple[Plain, Plain]:
    """See `decided`, the values of whose records these are."""
    asked, felt, command = TargetFriction(*target), FingerState(*finger), DriveCommand(*applied)
    after, point = decided(held[0], recorded(state), asked, felt, command)
    return plain(after), point[:]


@kernel
def decided(
    control: Control,
    state: ControllerState,
    target: TargetFriction,
    finger: FingerState,
    applied: DriveCommand,
) -> tuple[ControllerState, OperatingPoint]:
    """The operating point for `target` under the finger's present load; zero volts where nothing is
    asked.

    A target out of reach gives the nearest reachable friction, flagged. `applied` is the command of
    the tick before, which feedback compares with what the finger felt; NaN volts where nobody knows
    whether it is out.
    """
    known, commands = state.estimate, state.commands
    if control.learns:
        commands = feedback.remembered(commands, finger.time_s, applied)
        then = feedback.in_force(
            commands, finger.time_s - control.law.latency_s, control.law.timing_s
        )
        known = feedback.learnt(
            control.surface, control.correction, control.law, known, then, finger
        )
    if not (target.active and target.cof > 0.0 and finger.normal_force_n > 0.0):
        # before the first target the carrier waits where it will most likely be wanted: to move it
        # takes SCPI
        idle_hz = usual_hz(control) if np.isnan(state.frequency_hz) else state.frequency_hz
        idle = OperatingPoint(idle_hz, 0.0, np.nan, 0.0, 0.0, True, np.nan, np.nan)
        return ControllerState(state.frequency_hz, known, commands), idle
    solved = as_solved(control.surface, finger)
    frequency_hz, inverse, factors = chosen(control, known, target.cof, solved, state.frequency_hz)
    if control.learns and frequency_hz != state.frequency_hz and not np.isnan(state.frequency_hz):
        known = feedback.elsewhere(control.law, known, state.frequency_hz, frequency_hz)
        frequency_hz, inverse, factors = chosen(control, known, target.cof, solved, frequency_hz)
    point = as_felt(frequency_hz, inverse, factors, known.gains, target.cof)
    share = finger.normal_force_n / solved.normal_force_n
    return ControllerState(frequency_hz, known, commands), with_current(point, share)


@kernel
def with_current(point: OperatingPoint, share: float) -> OperatingPoint:
    """The point with that share of the sliding current: under the same pressure it goes with the
    load, as the area does.
    """
    return OperatingPoint(
        point.frequency_hz,
        point.voltage_v,
        point.cof,
        share * point.current_rms_a,
        point.stuck_current_rms_a,
        point.reachable,
        point.cof_low,
        point.cof_high,
    )


@kernel
def usual_hz(control: Control) -> float:
    """The carrier with most authority under a usual load."""
    if not np.isnan(control.choice.fixed_hz):
        return control.choice.fixed_hz
    nodes = control.surface.log_normal_force
    return float(
        np.exp(
            control.surface.log_frequency[
                best_node(control, np.inf, np.exp(nodes[nodes.size // 2]))
            ]
        )
    )


@kernel
def carried(
    held: Held, before: Held, values: Plain, speed_m_s: float, contact_s: float, voltage_v: float
) -> ControllerState:
    """The state on another surface than `before`, with gains that leave the friction of the present
    drive as it was.

    So a swap moves no voltage. Both gains become the same. The new surface describes what separated
    them, also at other carriers. With next to no voltage or without contact some usual ones are
    taken. Where nothing is learnt nothing is carried: the voltage goes to the new surface's by the
    drive's rate.
    """
    state = recorded(values)
    if not held[0].learns:
        return state
    new, old, known, frequency_hz = held[0], before[0], state.estimate, state.frequency_hz
    nodes, load_n, time_s = new.surface.log_normal_force, known.normal_force_n, known.time_s
    peak_v = voltage_v if voltage_v >= LEAST_V else USUAL_SHARE * new.surface.voltage_v[-1]
    drive = InForce(
        IDLE_HZ if np.isnan(frequency_hz) else frequency_hz, peak_v, peak_v, peak_v, True
    )
    finger = FingerState(
        0.0 if np.isnan(time_s) else time_s,
        0.0,
        0.0,
        speed_m_s,
        0.0,
        np.exp(nodes[nodes.size // 2]) if np.isnan(load_n) else load_n,
        True,
        np.nan,
        contact_s,
        np.nan,
        known.contact_area_m2,
    )
    (off_n, rise_n), _ = feedback.by_surface(new.surface, new.correction, drive, finger)
    (old_off_n, old_rise_n), _ = feedback.by_surface(old.surface, old.correction, drive, finger)
    level = (known.gains.off * old_off_n + known.gains.rise * old_rise_n) / (off_n + rise_n)
    # caution pulls by covariance over the gain of the rise: scaled so that the pull stays as well
    share = level * rise_n / (known.gains.rise * old_rise_n)
    estimate = feedback.rescaled(known, old_off_n / off_n, old_rise_n / rise_n, level, share)
    return ControllerState(frequency_hz, estimate, state.commands)


@kernel
def chosen(
    control: Control, known: Estimate, target_cof: float, finger: FingerState, present_hz: float
) -> tuple[float, Inverse, Factors]:
    """Frequency, what the surface says there, and the correction's factors: cof = off_gain off +
    rise_gain rise.

    The factors depend on the drive that the target asks for, so both are found together, in a few
    rounds. Of a finger that is little known less is asked.
    """
    surface, gains, force_n = control.surface, known.gains, finger.normal_force_n
    low = cof_at(surface, IDLE_HZ, 0.0, force_n)  # the same at any frequency
    factors, frequency_hz, inverse = (
        Factors(1.0, 1.0),
        control.choice.fixed_hz,
        Inverse(0.0, low, 0.0, 0.0, low, low),
    )
    last = CORRECTION_ROUNDS if control.corrected else 0
    for k in range(last + 1):
        if k > 0:
            factors = factors_at(control.correction, frequency_hz, inverse.voltage_v, finger)
        wanted = on_surface(gains, factors, low, target_cof)
        if k <= FREQUENCY_ROUNDS and np.isnan(control.choice.fixed_hz):
            frequency_hz = best_or_present(control, wanted, force_n, present_hz)
        if k == last and known.cautious:
            wanted = careful_cof(gains, factors, low, target_cof, control.law.caution)
        inverse = invert(surface, wanted, frequency_hz, force_n, control.caps)
    return frequency_hz, inverse, factors


@kernel
def on_surface(gains: Gains, factors: Factors, low: float, target_cof: float) -> float:
    """The surface's friction where this finger feels `target_cof`; `low` is that without
    voltage.
    """
    return low + (target_cof - gains.off * factors.off * low) / (gains.rise * factors.rise)


@kernel
def careful_cof(
    gains: Gains, factors: Factors, low: float, target_cof: float, caution: float
) -> float:
    """The surface's friction that is best for a finger whose gains are uncertain.

    It minimises (expected friction - target)^2 + caution * variance of friction: cautious control
    (Astrom and Wittenmark, Adaptive Control, 1995, ch. 7). What is known is met, whatever the
    target; of the rest less is asked.
    """
    off = factors.off * low
    wanted = gains.rise * (target_cof - gains.off * off) - caution * gains.covariance * off
    rise = wanted / (gains.rise * gains.rise + caution * gains.rise_variance)
    return low + max(rise, 0.0) / factors.rise


@kernel
def as_felt(
    frequency_hz: float, at: Inverse, factors: Factors, gains: Gains, target_cof: float
) -> OperatingPoint:
    """The operating point, with friction as this finger feels it."""
    low, rise = gains.off * factors.off * at.cof_low, gains.rise * factors.rise
    cof, high = low + rise * (at.cof - at.cof_low), low + rise * (at.cof_high - at.cof_low)
    current_a, stuck_a, in_reach = (
        at.current_rms_a,
        at.stuck_current_rms_a,
        low <= target_cof <= high,
    )
    return OperatingPoint(frequency_hz, at.voltage_v, cof, current_a, stuck_a, in_reach, low, high)


class Candidate(NamedTuple):
    """A frequency that the carrier may have: its rank by the policy, and what the target takes
    there.
    """

    rank: float
    at: Inverse


@kernel
def best_or_present(
    control: Control, target_cof: float, normal_force_n: float, present_hz: float
) -> float:
    """The best frequency, or the present one while that is not clearly worse; NaN for none."""
    surface = control.surface
    best_hz = np.exp(surface.log_frequency[best_node(control, target_cof, normal_force_n)])
    if np.isnan(present_hz) or present_hz == best_hz:
        return float(best_hz)
    best = candidate(control, best_hz, target_cof, normal_force_n)
    present = candidate(control, present_hz, target_cof, normal_force_n)
    return float(best_hz if is_clearly_better(control, best, present, target_cof) else present_hz)


@kernel
def candidate(control: Control, hz: float, target_cof: float, normal_force_n: float) -> Candidate:
    """One frequency; between nodes it has the rank of the nearer one."""
    i, a = locate(control.surface.log_frequency, np.log(hz))
    rank = control.choice.rank[i + (a > 0.5)]
    return Candidate(rank, invert(control.surface, target_cof, hz, normal_force_n, NO_CAPS))


@kernel
def is_clearly_better(
    control: Control, best: Candidate, present: Candidate, target_cof: float
) -> bool:
    """Whether one frequency is so much better than the other that the carrier should move."""
    clearly, high = 1.0 + control.hysteresis, present.at.cof_high
    if high < target_cof <= best.at.cof_high:
        return True
    if high < target_cof:
        return authority(best.at) > clearly * authority(present.at)
    # After a change of surface the present one may lie between nodes, the nearer of them too low.
    if present.rank != best.rank and np.isfinite(present.rank):
        is_at_its_limit = authority(best.at) <= clearly * (target_cof - best.at.cof_low)
        return present.rank > clearly * best.rank and not is_at_its_limit
    if not has_cost(control.choice):
        return authority(best.at) > clearly * authority(present.at)
    present_cost = cost(control.choice, present.at)
    return present_cost > 1.0 and present_cost > clearly * cost(control.choice, best.at)


@kernel
def best_node(control: Control, target_cof: float, normal_force_n: float) -> int:
    """The frequency that the policy prefers among those that reach the target.

    Where none does, it is the allowed one with most authority.
    """
    surface, choice, highest = control.surface, control.choice, control.highest
    j, b = locate(surface.log_normal_force, np.log(normal_force_n))
    strongest, most = -1, -1.0
    best, least_rank, least = -1, np.inf, np.inf
    for i in range(choice.rank.size):
        rank = choice.rank[i]
        if np.isinf(rank):
            continue
        high = between(highest[i, j, 1], highest[i, j, 2], b) if b > 0.0 else highest[i, j, 0]
        if strongest < 0 or high > most:
            strongest, most = i, high
        if high < target_cof or rank > least_rank:
            continue
        burden = -high
        if has_cost(choice):
            burden = cost(choice, invert_at(surface, target_cof, Place(i, 0.0, j, b), NO_CAPS))
        if rank < least_rank or burden < least:
            best, least_rank, least = i, rank, burden
    return best if best >= 0 else strongest


@kernel
def authority(at: Inverse) -> float:
    """How far friction can be raised at one frequency."""
    return at.cof_high - at.cof_low


@kernel
def has_cost(choice: Choice) -> bool:
    """Whether anything but rank and authority counts."""
    return choice.cost_per_v > 0.0 or choice.cost_per_a > 0.0


@kernel
def cost(choice: Choice, at: Inverse) -> float:
    """What the target costs at one frequency."""
    return choice.cost_per_v * at.voltage_v + choice.cost_per_a * at.current_rms_a


@kernel
def along(
    held: Held, gained: Plain, cautious: bool, target_cof: Array, felt: Plain, frequency_hz: float
) -> tuple[Array, Plain]:
    """Voltages [n] for targets at points to come, at one frequency, 0 for NaN; and the operating
    point of the peak.

    The correction's factors are those of the highest target's drive. A target out of reach gives
    the nearest reachable friction.
    """
    control, gains = held[0], Gains(*gained)
    surface, caps, factors = control.surface, control.caps, Factors(1.0, 1.0)
    real = FingerState(*felt)
    finger = as_solved(surface, real)
    place = place_of(surface, frequency_hz, finger.normal_force_n)
    most = invert_at(surface, np.inf, place, caps)
    low, high, largest = most.cof_low, most.cof_high, 0.0
    for m in range(target_cof.size):
        largest = max(largest, target_cof[m])
    for _ in range(CORRECTION_ROUNDS if control.corrected else 0):
        inverse = invert_at(surface, on_surface(gains, factors, low, largest), place, caps)
        factors = factors_at(control.correction, frequency_hz, inverse.voltage_v, finger)
    voltage_v, peak_cof = np.zeros(target_cof.size), low
    for m in range(target_cof.size):
        wanted = on_surface(gains, factors, low, target_cof[m])
        if cautious:
            wanted = careful_cof(gains, factors, low, target_cof[m], control.law.caution)
        if wanted >= high:
            voltage_v[m], peak_cof = most.voltage_v, high
        elif wanted > low:  # not for NaN
            voltage_v[m] = crossing_v(surface, surface.cof, place, wanted, most.voltage_v)
            peak_cof = max(peak_cof, wanted)
    peak = as_felt(frequency_hz, invert_at(surface, peak_cof, place, caps), factors, gains, largest)
    return voltage_v, with_current(peak, real.normal_force_n / finger.normal_force_n)[:]


@kernel
def reachable(held: Held, normal_force_n: float) -> tuple[float, float]:
    """Lowest and highest friction that the policy can reach under a load."""
    control, frequency_hz = held[0], held[0].choice.fixed_hz
    if np.isnan(frequency_hz):
        frequency_hz = np.exp(
            control.surface.log_frequency[best_node(control, np.inf, normal_force_n)]
        )
    most = invert(control.surface, np.inf, frequency_hz, normal_force_n, control.caps)
    return most.cof_low, most.cof_high


@kernel
def current_a(held: Held, frequency_hz: float, voltage_v: float, normal_force_n: float) -> float:
    """Current into the sliding finger at one point, A rms, as the surface says."""
    surface = held[0].surface
    return at_voltage(
        surface, surface.current_rms_a, place_of(surface, frequency_hz, normal_force_n), voltage_v
    )
