"""A high-voltage amplifier that clips, with its lines and a memory of the worst."""

from __future__ import annotations

import threading
from collections.abc import Callable

from hw.generator.contract import TerminalOutput


class SimulatedAmplifier:
    """Turns what the generator puts out into the voltage at the electrode.

    Stands for the far end of an amplifier's lines. `write` and `read` are the enable line (a
    digital output), `read_v` is the voltage monitor (an analog input). `interlock`, if given, is a
    contact in series with the enable line. Its history does not forget: `max_voltage_v` is the
    highest peak ever at the electrode, `output_on_s` the time with any voltage on it. Thread-safe.
    """

    def __init__(
        self,
        gain_v_per_v: float,
        voltage_limit_v: float,
        *,
        voltage_monitor_v_per_v: float = 0.01,
        enabled: bool = False,
        interlock: Callable[[], bool] = lambda: True,
    ) -> None:
        self._gain_v_per_v = gain_v_per_v
        self._voltage_limit_v = voltage_limit_v
        self._voltage_monitor_v_per_v = voltage_monitor_v_per_v
        self._enabled = enabled
        self._interlock = interlock
        self._input = TerminalOutput(0.0, 0.0, 0.0, on=False)
        self._lock = threading.RLock()
        self.max_voltage_v = 0.0
        self.output_on_s = 0.0

    @property
    def voltage_v(self) -> float:
        """Peak voltage at the electrode now, offset included."""
        output = self._input
        return self._amplified_v(output.amplitude_v + abs(output.offset_v))

    @property
    def output(self) -> TerminalOutput:
        """What is at the electrode now: the generator's output, amplified, and smaller where that
        would clip.
        """
        peak_v = self._input.amplitude_v + abs(self._input.offset_v)
        gain = self.voltage_v / peak_v if peak_v > 0.0 else 0.0
        amplitude_v, offset_v = gain * self._input.amplitude_v, gain * self._input.offset_v
        return self._input._replace(amplitude_v=amplitude_v, offset_v=offset_v, on=gain > 0.0)

    def drive(self, output: TerminalOutput) -> float:
        """Take the generator's output as input; return the peak voltage at the electrode."""
        with self._lock:
            self._input = output
            return self._note()

    def step(self, dt_s: float, output: TerminalOutput) -> float:
        """Hold the generator's output for `dt_s` of simulated time; return the peak voltage at the
        electrode.
        """
        voltage_v = self.drive(output)
        with self._lock:
            self.output_on_s += dt_s if voltage_v > 0.0 else 0.0
        return voltage_v

    def write(self, value: bool, /) -> None:
        """Set the enable line."""
        with self._lock:
            self._enabled = value
            self._note()

    def read(self) -> bool:
        """Return the level of the enable line."""
        return self._enabled

    def read_v(self) -> float:
        """Return the voltage monitor's reading of the peak, V."""
        return self.voltage_v * self._voltage_monitor_v_per_v

    def _amplified_v(self, input_v: float) -> float:
        on = self._input.on and self._enabled and self._interlock()
        return min(self._gain_v_per_v * input_v, self._voltage_limit_v) if on else 0.0

    def _note(self) -> float:
        self.max_voltage_v = max(self.max_voltage_v, self.voltage_v)
        return self.voltage_v
