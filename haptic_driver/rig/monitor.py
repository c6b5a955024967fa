"""Does the amplifier do what was commanded? Its lines and monitors say so, in their own time."""

from __future__ import annotations

import math
from typing import NamedTuple

from haptic_driver.base.units import readable
from haptic_driver.limits import OperatingLimits
from haptic_driver.rig.config import SafetySettings
from hw.amplifier.analog import AmplifierState, AnalogAmplifier


class _Commanded(NamedTuple):
    """A voltage, and a time by which it had certainly been sent: the first look after its dialogue,
    which may stall.

    `current_a`: the highest peak through the panel and through people within the limit.
    """

    voltage_v: float
    current_a: float = math.inf
    told_s: float = math.inf


_ZERO = _Commanded(0.0, told_s=-math.inf)


def line_contradiction(amplifier: AnalogAmplifier) -> str | None:
    """Why an amplifier that should be on is not, or that it gives more current than it may; None
    when all is well.
    """
    state = amplifier.state
    if state is AmplifierState.TRIPPED:
        return "the amplifier's fault line says fault"
    if state is AmplifierState.DISABLED:
        return "the amplifier's enable line reads low: interlock or E-stop"
    current_a, limit_a = amplifier.monitor_current_a(), amplifier.settings.current_limit_a
    if current_a is not None and abs(current_a) > limit_a:
        return (
            f"the current monitor reads {readable(current_a, 'A')}, the limit is"
            f" {readable(limit_a, 'A')}"
        )
    return None


class _Lasting:
    """For how long something has been so without a break."""

    def __init__(self) -> None:
        self._since_s: float | None = None

    def for_s(self, is_so: bool, time_s: float) -> float:
        if not is_so:
            self._since_s = None
            return 0.0
        if self._since_s is None:
            self._since_s = time_s
        return time_s - self._since_s


class MonitorCheck:
    """Compares the monitors with what was commanded within the last `settle_s`, as late as a
    monitor may be.

    `modulated`: the amplitude follows an analog output below the set point, so that the monitor may
    show less.
    """

    def __init__(self, safety: SafetySettings, limits: OperatingLimits, modulated: bool) -> None:
        self._safety = safety
        self._limits = limits
        self._modulated = modulated
        self._commanded = [_ZERO]
        self._too_low, self._too_much_current = _Lasting(), _Lasting()
        self._quiet_a = math.inf

    def comes_on(self, current_a: float | None) -> None:
        """The current monitor reads this of an output that is off. Its own noise is the least that
        was seen: it may still show what flowed a moment ago.
        """
        if current_a is not None:
            self._quiet_a = min(self._quiet_a, abs(current_a))

    def commanded(self, frequency_hz: float, voltage_v: float, is_sine: bool) -> None:
        """This voltage is being sent to the generator; what has steps charges a panel in
        spikes, of which nothing is known.
        """
        current_a = math.inf
        if is_sine:
            panel_s = 2.0 * math.pi * frequency_hz * self._limits.panel_capacitance_f
            people_a = math.sqrt(2.0) * self._limits.contact_current_limit_a_rms(frequency_hz)
            current_a = panel_s * voltage_v + float(people_a)
        self._commanded.append(_Commanded(voltage_v, current_a))

    def switched_off(self, shown: bool) -> None:
        """Zero was commanded; where that was shown, what came before does not count any more."""
        self._commanded = [_ZERO] if shown else [*self._commanded, _ZERO]
        self._too_low, self._too_much_current = _Lasting(), _Lasting()

    def contradiction(
        self, time_s: float, voltage_v: float | None, current_a: float | None
    ) -> str | None:
        """What the monitors say against the commands: at once when a voltage reads too much.

        Too little must last, since nobody is hurt by it and a busy computer or instrument may be
        late with a voltage. So must too much current, since a set point's step has a spike.
        """
        told = self._within(time_s)
        found = None if voltage_v is None else self._by_voltage(time_s, told, abs(voltage_v))
        if found is None and current_a is not None:
            found = self._by_current(time_s, told, abs(current_a))
        return found

    def _by_voltage(self, time_s: float, told: list[_Commanded], reads_v: float) -> str | None:
        voltages_v = [one.voltage_v for one in told]
        low_v, high_v = 0.0 if self._modulated else min(voltages_v), max(voltages_v)
        tolerance_v = max(self._safety.monitor_tolerance_v, self._safety.monitor_tolerance * high_v)
        reads = (
            f"the monitor reads {reads_v:.3g} V where {low_v:.3g}..{high_v:.3g} V were commanded"
        )
        if reads_v > high_v + tolerance_v:
            return reads
        low_s = self._too_low.for_s(reads_v < low_v - tolerance_v, time_s)
        return f"{reads}, for {low_s:.2g} s" if low_s >= self._safety.settle_s else None

    def _by_current(self, time_s: float, told: list[_Commanded], reads_a: float) -> str | None:
        """More than the panel takes goes through whoever touches."""
        most_a = max(one.current_a for one in told)
        noise_a = self._quiet_a if self._quiet_a < math.inf else 0.0
        is_more = reads_a - noise_a > most_a * (1.0 + self._safety.monitor_tolerance)
        if self._too_much_current.for_s(is_more, time_s) < self._safety.settle_s:
            return None
        return (
            f"the current monitor reads {readable(reads_a, 'A')} where the panel and contact within"
            f" the limit take {readable(most_a, 'A')} at most: more touches than"
            " limits.touching_area_m2 says, or limits.panel_capacitance_f is too small"
        )

    def _within(self, time_s: float) -> list[_Commanded]:
        """What was commanded within `settle_s`, that in force at its beginning included."""
        told = [
            one if one.told_s < math.inf else one._replace(told_s=time_s) for one in self._commanded
        ]
        while len(told) > 1 and told[1].told_s <= time_s - self._safety.settle_s:
            del told[0]
        self._commanded = told
        return told
