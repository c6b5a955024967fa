"""A simulated amplifier that trips, with a fault line and a current monitor."""

from __future__ import annotations

import math
from typing import Any

from hw.amplifier.simulated import SimulatedAmplifier


class TrippingAmplifier(SimulatedAmplifier):
    """More than `current_limit_a` through `panel_capacitance_f` trips it until the enable line is
    dropped.

    Peak, 2 pi f C V, V without the offset.
    """

    def __init__(
        self,
        gain_v_per_v: float,
        voltage_limit_v: float,
        *,
        current_monitor_v_per_a: float = 1.0,
        current_limit_a: float = math.inf,
        panel_capacitance_f: float = 0.0,
        **given: Any,
    ) -> None:
        super().__init__(gain_v_per_v, voltage_limit_v, **given)
        self._current_limit_a = current_limit_a
        self._panel_capacitance_f = panel_capacitance_f
        self.tripped = False
        self.fault_line = FaultLine(self)
        self.current_monitor = CurrentMonitor(self, current_monitor_v_per_a)

    @property
    def current_a(self) -> float:
        """Peak current into the panel now; a constant voltage drives none."""
        output = self._input
        return (
            2.0
            * math.pi
            * output.frequency_hz
            * self._panel_capacitance_f
            * self._amplified_v(output.amplitude_v)
        )

    def trip(self) -> None:
        """Switch itself off, as for heat or a short circuit, until the enable line is dropped."""
        with self._lock:
            self.tripped = True

    def write(self, value: bool, /) -> None:
        with self._lock:
            self.tripped = self.tripped and value
            super().write(value)

    def _amplified_v(self, input_v: float) -> float:
        return 0.0 if self.tripped else super()._amplified_v(input_v)

    def _note(self) -> float:
        self.tripped = self.tripped or self.current_a > self._current_limit_a
        return super()._note()


class FaultLine:
    """High while the amplifier is tripped: a digital input."""

    def __init__(self, amplifier: TrippingAmplifier) -> None:
        self._amplifier = amplifier

    def read(self) -> bool:
        return self._amplifier.tripped


class CurrentMonitor:
    """The amplifier's current, scaled: an analog input."""

    def __init__(self, amplifier: TrippingAmplifier, volts_per_ampere: float) -> None:
        self._amplifier = amplifier
        self._volts_per_ampere = volts_per_ampere

    def read_v(self) -> float:
        return self._amplifier.current_a * self._volts_per_ampere
