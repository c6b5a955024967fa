"""Target friction -> operating point: which frequency, then which voltage.

A policy names what the frequency is chosen for; the voltage then follows from the surface. The force pulses at twice
the carrier, so no policy but `fixed_frequency` goes below `lowest_carrier_hz`.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import hypot, isnan, nan
from typing import Any, Literal, NamedTuple, get_args

import numpy as np

from haptic_driver.errors import BadInputError
from haptic_driver.limits import OperatingLimits
from haptic_driver.render import feedback, kernels
from haptic_driver.render.correction import NO_CORRECTION, Correction
from haptic_driver.render.feedback import NO_FEEDBACK, FeedbackState
from haptic_driver.render.kernels import (
    LOG_FREQUENCY,
    MERIT_AUTHORITY,
    MERIT_CURRENT,
    MERIT_VOLTAGE,
    Array,
    Estimate,
    FeedbackSettings,
)
from haptic_driver.render.surface import Surface, best_frequency, highest_cof, invert, stuck_current_a_per_v
from haptic_driver.signals import NO_COMMAND, DriveCommand, FingerState, OperatingPoint, TargetFriction

Policy = Literal["max_authority", "min_voltage", "min_current", "fixed_frequency", "carrier"]
POLICIES: tuple[Policy, ...] = get_args(Policy)
MERITS = {"min_voltage": MERIT_VOLTAGE, "min_current": MERIT_CURRENT}
CARRIER_BAND_HZ = 10e3
_GAIN, _AT_LIMIT = Estimate._fields.index("gain"), Estimate._fields.index("at_limit")
CLEAR = 1e-9  # kept clear of a limit against rounding


@dataclass(frozen=True)
class ControllerSettings:
    """A surface and how to use it.

    `hysteresis`: how much better (relative) another frequency must be before the carrier moves there.
    `fixed_frequency_hz` belongs to the policy `fixed_frequency`; between the surface's nodes `limits` hold exactly.
    `correction`: what the finger's speed and the time do to friction, where the model says they do anything.
    `feedback`: how the finger's own gains are learnt from measured friction; None leaves them at 1.
    """

    surface: Surface
    limits: OperatingLimits
    policy: Policy = "max_authority"
    fixed_frequency_hz: float | None = None
    lowest_carrier_hz: float = 100.0
    hysteresis: float = 0.05
    correction: Correction | None = None
    feedback: FeedbackSettings | None = None

    def __post_init__(self) -> None:
        """Refuse settings under which no frequency could be chosen."""
        low, high = np.exp(self.surface.axes[LOG_FREQUENCY, :2])
        if self.policy not in POLICIES:
            raise BadInputError("bad_policy", f"there is no policy '{self.policy}'", f"Known: {', '.join(POLICIES)}")
        if self.policy == "fixed_frequency":
            f = self.fixed_frequency_hz
            if f is None or not low * (1 - 1e-9) <= f <= high * (1 + 1e-9):
                raise BadInputError(
                    "bad_frequency",
                    "policy fixed_frequency: "
                    + ("no frequency is given" if f is None else f"{f:g} Hz is not on the surface"),
                    f"Give fixed_frequency_hz of {low:g}..{high:g} Hz",
                )
        elif self.band[0] >= self.band[1]:
            raise BadInputError(
                "bad_frequency", f"policy {self.policy} finds no frequency on a surface of {low:g}..{high:g} Hz",
                "Build a surface that reaches higher",
            )  # fmt: skip

    @property
    def band(self) -> tuple[int, int]:
        """First and one past the last frequency node that the policy may use."""
        lowest = CARRIER_BAND_HZ if self.policy == "carrier" else self.lowest_carrier_hz
        nodes = self.surface.nodes(LOG_FREQUENCY)
        return int(np.searchsorted(nodes, np.log(lowest) - 1e-9)), nodes.size

    @property
    def merit(self) -> int:
        """What frequencies are compared by."""
        return MERITS.get(self.policy, MERIT_AUTHORITY)


class ControllerState(NamedTuple):
    """The frequency in use, None before the first target; what is known of the finger, None without feedback."""

    frequency_hz: float | None
    feedback: FeedbackState | None = None

    @property
    def known(self) -> Array:
        """The fields of the estimate in a row."""
        return feedback.NEUTRAL_KNOWN if self.feedback is None else self.feedback.known

    @property
    def gain(self) -> float:
        """What the finger's gains make of the friction at the present drive."""
        return self.known.item(_GAIN)

    @property
    def at_limit(self) -> bool:
        """Whether one of the gains stands at its bound."""
        return self.known.item(_AT_LIMIT) > 0.0

    @property
    def estimate(self) -> Estimate:
        """The finger's gains, with their drift; 1 without feedback."""
        return feedback.NEUTRAL if self.feedback is None else self.feedback.estimate


INITIAL = ControllerState(None)


class Controller:
    """The stage with everything that depends on settings alone worked out once."""

    def __init__(self, settings: ControllerSettings) -> None:
        self.settings = settings
        surface, correction = Surface(*map(_laid_out, settings.surface)), settings.correction
        law = settings.feedback
        self._first_feedback = NO_FEEDBACK if law is None else feedback.initial(law)
        self._learns = law is not None
        self._margin = 0.0 if law is None else law.margin
        self._fixed = settings.fixed_frequency_hz if settings.policy == "fixed_frequency" else None
        self._caps = _caps(settings) if self._fixed is not None else (np.inf, np.inf)
        is_corrected = correction is not None
        factors = tuple(map(_laid_out, NO_CORRECTION if correction is None else correction))
        fixed_hz = nan if self._fixed is None else self._fixed
        how = (
            is_corrected, *settings.band, settings.merit, fixed_hz, settings.hysteresis, *self._caps, self._margin
        )  # fmt: skip
        learning = np.array(law if law is not None else ())
        self._what: tuple[Any, ...] = (*surface, highest_cof(surface), *factors, np.array(how), learning)
        self._along: tuple[Any, ...] = (*surface, *factors, is_corrected)

    def __reduce__(self) -> tuple[type[Controller], tuple[ControllerSettings]]:
        """Another process works out the rest again, instead of being sent everything twice."""
        return Controller, (self.settings,)

    def step(
        self, state: ControllerState, target: TargetFriction, finger: FingerState, applied: DriveCommand = NO_COMMAND
    ) -> tuple[ControllerState, OperatingPoint]:
        """The operating point for `target` under the finger's present load; zero volts where nothing is asked.

        A target out of reach gives the nearest reachable friction, flagged. `applied` is the command of the tick
        before, which feedback compares with what the finger felt; NaN volts where nobody knows whether it is out.
        """
        known, commands = state.feedback or self._first_feedback
        then = FeedbackState(np.empty(known.shape), np.empty(commands.shape))
        target_cof = target.cof if target.active else nan
        arguments = (
            *self._what, known, commands, *then,
            target_cof, finger.time_s, hypot(finger.velocity_x_m_s, finger.velocity_y_m_s), finger.normal_force_n,
            finger.lateral_force_n, finger.in_contact, applied.frequency_hz, applied.voltage_v,
            nan if state.frequency_hz is None else state.frequency_hz,
        )  # fmt: skip
        frequency_hz, voltage_v, cof, current_a, stuck_a, low, high = kernels.control(*arguments)
        learnt = then if self._learns else None
        if isnan(frequency_hz):
            state = ControllerState(state.frequency_hz, learnt)
            return state, _idle(state)
        reachable = low <= target_cof <= high
        point = OperatingPoint(frequency_hz, voltage_v, cof, current_a, stuck_a, reachable, low, high)
        return ControllerState(frequency_hz, learnt), point

    def along(
        self, state: ControllerState, target_cof: Array, finger: FingerState, frequency_hz: float
    ) -> tuple[Array, OperatingPoint]:
        """Voltages [n] for targets at points to come, at one frequency, 0 for NaN; and the operating point of the peak.

        Finger and gains are those of this tick. A target out of reach gives the nearest reachable friction.
        """
        voltage_v = np.empty(target_cof.size)
        arguments = (
            *self._along, *self._caps, state.known, self._margin,
            target_cof, frequency_hz, finger.normal_force_n,
            hypot(finger.velocity_x_m_s, finger.velocity_y_m_s), finger.time_s, voltage_v,
        )  # fmt: skip
        peak_v, cof, current_a, stuck_a, low, high = kernels.voltages(*arguments)
        return voltage_v, OperatingPoint(frequency_hz, peak_v, cof, current_a, stuck_a, True, low, high)

    def reachable(self, normal_force_n: float) -> tuple[float, float]:
        """Lowest and highest friction that the policy can reach under a load."""
        best_hz = self._fixed
        if best_hz is None:
            index = best_frequency(
                self.settings.surface, np.inf, normal_force_n, *self.settings.band, MERIT_AUTHORITY
            )  # fmt: skip
            best_hz = float(np.exp(self.settings.surface.nodes(LOG_FREQUENCY)[index]))
        inverse = invert(self.settings.surface, np.inf, best_hz, normal_force_n, *self._caps)
        return inverse.cof_low, inverse.cof_high


def _laid_out(values: Array) -> Array:
    """The same numbers laid out as every rig has them: another layout would be compiled for anew."""
    return np.require(values, np.float64, ["C", "A", "W"])


def _caps(settings: ControllerSettings) -> tuple[float, float]:
    """Largest voltage and sliding current that the limits allow at the fixed frequency."""
    f = settings.fixed_frequency_hz
    if f is None:
        return np.inf, np.inf
    voltage = settings.limits.highest_voltage_v(f, stuck_current_a_per_v(settings.surface, f))
    current = settings.limits.contact_current_limit_a_rms(f)
    return float(voltage) * (1.0 - CLEAR), float(current) * (1.0 - CLEAR)


def _idle(state: ControllerState) -> OperatingPoint:
    nothing = float("nan")
    return OperatingPoint(state.frequency_hz or CARRIER_BAND_HZ, 0.0, nothing, 0.0, 0.0, True, nothing, nothing)
