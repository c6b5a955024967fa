"""A high-voltage amplifier that clips and trips, with all its lines and a memory of the worst."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable

from hw.generator.contract import TerminalOutput


class SimulatedAmplifier:
    """Turns what the generator puts out into the voltage at the electrode.

    Itself the far end of an amplifier's lines: `write` and `read` are the enable line (a digital output), `read_v`
    is the voltage monitor (an analog input); `fault_line` and `current_monitor` are the other two. `interlock`, if
    given, is a contact in series with the enable line. More than `current_limit_a` through `panel_capacitance_f`
    (peak, 2 pi f C V, V without the offset) trips it until the enable line is dropped. Its history does not forget:
    `max_voltage_v` is the highest peak ever at the electrode, `output_on_s` the time with any voltage on it.
    Thread-safe.
    """

    def __init__(
        self,
        gain_v_per_v: float,
        voltage_limit_v: float,
        *,
        voltage_monitor_v_per_v: float = 0.01,
        current_monitor_v_per_a: float = 1.0,
        current_limit_a: float = math.inf,
        panel_capacitance_f: float = 0.0,
        enabled: bool = False,
        interlock: Callable[[], bool] = lambda: True,
    ) -> None:
        self._gain_v_per_v = gain_v_per_v
        self._voltage_limit_v = voltage_limit_v
        self._voltage_monitor_v_per_v = voltage_monitor_v_per_v
        self._current_limit_a = current_limit_a
        self._panel_capacitance_f = panel_capacitance_f
        self._enabled = enabled
        self._interlock = interlock
        self._tripped = False
        self._input = TerminalOutput(0.0, 0.0, 0.0, on=False)
        self._lock = threading.RLock()
        self.fault_line = FaultLine(self)
        self.current_monitor = CurrentMonitor(self, current_monitor_v_per_a)
        self.max_voltage_v = 0.0
        self.output_on_s = 0.0

    @property
    def voltage_v(self) -> float:
        """Peak voltage at the electrode now, offset included."""
        output = self._input
        return self._amplified_v(output.amplitude_v + abs(output.offset_v))

    @property
    def current_a(self) -> float:
        """Peak current into the panel now; a constant voltage drives none."""
        output = self._input
        return 2.0 * math.pi * output.frequency_hz * self._panel_capacitance_f * self._amplified_v(output.amplitude_v)

    @property
    def tripped(self) -> bool:
        """Whether it has switched itself off."""
        return self._tripped

    def trip(self) -> None:
        """Switch itself off, as for heat or a short circuit, until the enable line is dropped."""
        with self._lock:
            self._tripped = True

    def drive(self, output: TerminalOutput) -> float:
        """Take the generator's output as input; return the peak voltage at the electrode."""
        with self._lock:
            self._input = output
            return self._note()

    def step(self, dt_s: float, output: TerminalOutput) -> float:
        """Hold the generator's output for `dt_s` of simulated time; return the peak voltage at the electrode."""
        voltage_v = self.drive(output)
        with self._lock:
            self.output_on_s += dt_s if voltage_v > 0.0 else 0.0
        return voltage_v

    def write(self, value: bool, /) -> None:
        """Set the enable line."""
        with self._lock:
            self._enabled = value
            self._tripped = self._tripped and value
            self._note()

    def read(self) -> bool:
        """Return the level of the enable line."""
        return self._enabled

    def read_v(self) -> float:
        """Return the voltage monitor's reading of the peak, V."""
        return self.voltage_v * self._voltage_monitor_v_per_v

    def _amplified_v(self, input_v: float) -> float:
        on = self._input.on and self._enabled and not self._tripped and self._interlock()
        return min(self._gain_v_per_v * input_v, self._voltage_limit_v) if on else 0.0

    def _note(self) -> float:
        self._tripped = self._tripped or self.current_a > self._current_limit_a
        self.max_voltage_v = max(self.max_voltage_v, self.voltage_v)
        return self.voltage_v


class FaultLine:
    """High while the amplifier is tripped: a digital input."""

    def __init__(self, amplifier: SimulatedAmplifier) -> None:
        self._amplifier = amplifier

    def read(self) -> bool:
        """Return the level."""
        return self._amplifier.tripped


class CurrentMonitor:
    """The amplifier's current, scaled: an analog input."""

    def __init__(self, amplifier: SimulatedAmplifier, volts_per_ampere: float) -> None:
        self._amplifier = amplifier
        self._volts_per_ampere = volts_per_ampere

    def read_v(self) -> float:
        """Return the peak current's reading, V."""
        return self._amplifier.current_a * self._volts_per_ampere
