"""Does the amplifier do what was commanded? Its lines and monitors say so, in their own time."""

from __future__ import annotations

import math
from typing import NamedTuple

from haptic_driver.base.units import readable
from haptic_driver.rig.config import SafetySettings
from hw.amplifier.analog import AmplifierState, AnalogAmplifier


class _Commanded(NamedTuple):
    """A voltage, and a time by which it had certainly been sent: the first look after its dialogue,
    which may stall.
    """

    voltage_v: float
    told_s: float = math.inf


_ZERO = _Commanded(0.0, -math.inf)


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


class VoltageCheck:
    """Compares the voltage monitor with what was commanded within the last `settle_s`, as late as a
    monitor may be.

    `modulated`: the amplitude follows an analog output below the set point, so that the monitor may
    show less.
    """

    def __init__(self, safety: SafetySettings, modulated: bool) -> None:
        self._safety = safety
        self._modulated = modulated
        self._commanded = [_ZERO]
        self._too_low_s: float | None = None  # since when it has read less than was commanded

    def commanded(self, voltage_v: float) -> None:
        """This voltage is being sent to the generator."""
        self._commanded.append(_Commanded(voltage_v))

    def switched_off(self, shown: bool) -> None:
        """Zero was commanded; where that was shown, what came before does not count any more."""
        self._commanded = [_ZERO] if shown else [*self._commanded, _ZERO]
        self._too_low_s = None

    def contradiction(self, time_s: float, voltage_v: float | None) -> str | None:
        """What the monitor says against the commands: at once when it reads too much.

        Too little must last, since nobody is hurt by it and a busy computer or instrument may be
        late with a voltage.
        """
        low_v, high_v = self._range_v(time_s)
        if voltage_v is None:
            return None
        low_v = 0.0 if self._modulated else low_v
        tolerance_v = max(self._safety.monitor_tolerance_v, self._safety.monitor_tolerance * high_v)
        reads = (
            f"the monitor reads {abs(voltage_v):.3g} V where {low_v:.3g}..{high_v:.3g} V were"
            " commanded"
        )
        if abs(voltage_v) > high_v + tolerance_v:
            return reads
        if abs(voltage_v) >= low_v - tolerance_v:
            self._too_low_s = None
        elif self._too_low_s is None:
            self._too_low_s = time_s
        elif time_s - self._too_low_s >= self._safety.settle_s:
            return f"{reads}, for {time_s - self._too_low_s:.2g} s"
        return None

    def _range_v(self, time_s: float) -> tuple[float, float]:
        """Lowest and highest voltage commanded within `settle_s`, that in force at its beginning
        included.
        """
        told = [
            one if one.told_s < math.inf else one._replace(told_s=time_s) for one in self._commanded
        ]
        while len(told) > 1 and told[1].told_s <= time_s - self._safety.settle_s:
            del told[0]
        self._commanded = told
        voltages_v = [one.voltage_v for one in told]
        return min(voltages_v), max(voltages_v)
