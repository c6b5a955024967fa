"""Target friction -> operating point: which frequency, then which voltage.

A policy names what the frequency is chosen for; the voltage then follows from the surface. The force pulses at twice
the carrier, so no policy but `fixed_frequency` goes below `lowest_carrier_hz`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, NamedTuple, get_args

import numpy as np

from haptic_driver.errors import BadInputError
from haptic_driver.limits import OperatingLimits
from haptic_driver.render.correction import Correction
from haptic_driver.render.surface import (
    LOG_FREQUENCY,
    MERIT_AUTHORITY,
    MERIT_CURRENT,
    MERIT_VOLTAGE,
    Inverse,
    Surface,
    best_frequency,
    invert,
    stuck_current_a_per_v,
)
from haptic_driver.signals import FingerState, OperatingPoint, TargetFriction

Policy = Literal["max_authority", "min_voltage", "min_current", "fixed_frequency", "carrier"]
POLICIES: tuple[Policy, ...] = get_args(Policy)
MERITS = {"min_voltage": MERIT_VOLTAGE, "min_current": MERIT_CURRENT}
CARRIER_BAND_HZ = 10e3
CORRECTION_ROUNDS = 4
CLEAR = 1e-9  # kept clear of a limit against rounding
WORTH_COMPARING = {MERIT_AUTHORITY: 0.0, MERIT_VOLTAGE: 1.0, MERIT_CURRENT: 1e-6}  # below, costs are as good as equal


@dataclass(frozen=True)
class ControllerSettings:
    """A surface and how to use it.

    `hysteresis`: how much better (relative) another frequency must be before the carrier moves there.
    `fixed_frequency_hz` belongs to the policy `fixed_frequency`; between the surface's nodes `limits` hold exactly.
    `correction`: what the finger's speed and the time do to friction, where the model says they do anything.
    """

    surface: Surface
    policy: Policy = "max_authority"
    fixed_frequency_hz: float | None = None
    lowest_carrier_hz: float = 100.0
    hysteresis: float = 0.05
    limits: OperatingLimits | None = None
    correction: Correction | None = None

    def __post_init__(self) -> None:
        """Refuse settings under which no frequency could be chosen."""
        low, high = np.exp(self.surface.axes[LOG_FREQUENCY, :2])
        if self.policy not in POLICIES:
            raise BadInputError("bad_policy", f"there is no policy '{self.policy}'", f"Known: {', '.join(POLICIES)}")
        if self.policy == "fixed_frequency":
            f = self.fixed_frequency_hz
            if f is None or not low * (1 - 1e-9) <= f <= high * (1 + 1e-9):
                raise BadInputError(
                    "bad_frequency", f"fixed frequency {f} Hz is not on the surface", f"Give {low:g}..{high:g} Hz"
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
    """The frequency in use; None before the first target."""

    frequency_hz: float | None


INITIAL = ControllerState(None)


class Controller:
    """The stage with everything that depends on settings alone worked out once."""

    def __init__(self, settings: ControllerSettings) -> None:
        self.settings = settings
        self._frequencies = [float(f) for f in np.exp(settings.surface.nodes(LOG_FREQUENCY))]
        self._band = settings.band
        self._merit = settings.merit
        self._fixed = settings.fixed_frequency_hz if settings.policy == "fixed_frequency" else None
        self._caps = _caps(settings) if self._fixed is not None else (np.inf, np.inf)

    def step(
        self, state: ControllerState, target: TargetFriction, finger: FingerState
    ) -> tuple[ControllerState, OperatingPoint]:
        """The operating point for `target` under the finger's present load; zero volts where nothing is asked.

        A target out of reach gives the nearest reachable friction, flagged.
        """
        if not target.active or not target.cof > 0.0 or not finger.normal_force_n > 0.0:
            return state, _idle(state)
        correction = self.settings.correction
        if correction is not None:
            return self._corrected(correction, state, target.cof, finger)
        frequency_hz, inverse = self._choose(state.frequency_hz, target.cof, finger.normal_force_n)
        return ControllerState(frequency_hz), self._point(frequency_hz, inverse, target.cof)

    def _corrected(
        self, correction: Correction, state: ControllerState, cof: float, finger: FingerState
    ) -> tuple[ControllerState, OperatingPoint]:
        """The same through the correction: the target is taken back to the surface's speed and time, the answer forth.

        The factors depend on the drive that the target asks for, so both are found together, in a few rounds.
        """
        force_n = finger.normal_force_n
        low, _ = self.reachable(force_n)
        frequency_hz, inverse = self._choose(state.frequency_hz, cof, force_n)
        for _ in range(CORRECTION_ROUNDS):
            off, gain = correction.at(frequency_hz, inverse.voltage_v, finger)
            frequency_hz, inverse = self._choose(frequency_hz, low + (cof - off * low) / gain, force_n)
        forth = [off * low + gain * (value - low) for value in (inverse.cof, inverse.cof_low, inverse.cof_high)]
        inverse = inverse._replace(cof=forth[0], cof_low=forth[1], cof_high=forth[2])
        return ControllerState(frequency_hz), self._point(frequency_hz, inverse, cof)

    @staticmethod
    def _point(frequency_hz: float, inverse: Inverse, cof: float) -> OperatingPoint:
        return OperatingPoint(
            frequency_hz=frequency_hz,
            voltage_v=inverse.voltage_v,
            cof=inverse.cof,
            current_rms_a=inverse.current_rms_a,
            stuck_current_rms_a=inverse.stuck_current_rms_a,
            reachable=inverse.cof_low <= cof <= inverse.cof_high,
            cof_low=inverse.cof_low,
            cof_high=inverse.cof_high,
        )

    def reachable(self, normal_force_n: float) -> tuple[float, float]:
        """Lowest and highest friction that the policy can reach under a load."""
        best = self._fixed
        if best is None:
            index = best_frequency(self.settings.surface, np.inf, normal_force_n, *self._band, MERIT_AUTHORITY)
            best = self._frequencies[index]
        inverse = invert(self.settings.surface, np.inf, best, normal_force_n, *self._caps)
        return inverse.cof_low, inverse.cof_high

    def _choose(self, present_hz: float | None, cof: float, normal_force_n: float) -> tuple[float, Inverse]:
        surface = self.settings.surface
        if self._fixed is not None:
            return self._fixed, invert(surface, cof, self._fixed, normal_force_n, *self._caps)
        index = best_frequency(surface, cof, normal_force_n, *self._band, self._merit)
        best_hz = self._frequencies[index]
        best = invert(surface, cof, best_hz, normal_force_n)
        if present_hz is None or present_hz == best_hz:
            return best_hz, best
        present = invert(surface, cof, present_hz, normal_force_n)
        return (best_hz, best) if self._clearly_better(best, present, cof) else (present_hz, present)

    def _clearly_better(self, best: Inverse, present: Inverse, cof: float) -> bool:
        if present.cof_high < cof <= best.cof_high:
            return True
        margin = 1.0 + self.settings.hysteresis
        if self._merit == MERIT_AUTHORITY or present.cof_high < cof:
            return best.cof_high - best.cof_low > margin * (present.cof_high - present.cof_low)
        if self._merit == MERIT_VOLTAGE:
            old, new = present.voltage_v, best.voltage_v
        else:
            old, new = present.current_rms_a, best.current_rms_a
        return old > WORTH_COMPARING[self._merit] and old > margin * new


def _caps(settings: ControllerSettings) -> tuple[float, float]:
    """Largest voltage and sliding current that the limits allow at the fixed frequency."""
    if settings.limits is None or settings.fixed_frequency_hz is None:
        return np.inf, np.inf
    f = settings.fixed_frequency_hz
    voltage = settings.limits.highest_voltage_v(f, stuck_current_a_per_v(settings.surface, f))
    current = settings.limits.contact_current_limit_a_rms(f)
    return float(voltage) * (1.0 - CLEAR), float(current) * (1.0 - CLEAR)


def _idle(state: ControllerState) -> OperatingPoint:
    nothing = float("nan")
    return OperatingPoint(state.frequency_hz or CARRIER_BAND_HZ, 0.0, nothing, 0.0, 0.0, True, nothing, nothing)
