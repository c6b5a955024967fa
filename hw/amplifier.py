"""The high-voltage amplifier: a box with a few lines, any of which may be absent."""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass
from typing import Protocol

from hw.errors import DeviceError, LimitExceeded


class DigitalOutput(Protocol):
    """One digital line that can be set and read back; both raise DeviceError when the line is dead."""

    def write(self, value: bool, /) -> None:
        """Set the line."""

    def read(self) -> bool:
        """Return the level that is on the line."""


class AnalogInput(Protocol):
    """One analog input; raises DeviceError when it cannot be read."""

    def read_v(self) -> float:
        """Return the voltage at the input, V."""


class AmplifierState(enum.Enum):
    """What is known about the high voltage; UNKNOWN is never to be shown as off."""

    ENABLED = "enabled"
    DISABLED = "disabled"
    UNKNOWN = "unknown"


@dataclass(frozen=True)
class AmplifierSettings:
    """What the amplifier is and may do, as measured or from its data sheet.

    Voltages and currents are peak values at the electrode; `voltage_monitor_v_per_v` is volts at the monitor
    output per volt at the electrode (0.01 for 1 V per 100 V). Raises ValueError unless all are > 0.
    """

    gain_v_per_v: float
    voltage_limit_v: float
    current_limit_a: float
    slew_limit_v_per_s: float
    voltage_monitor_v_per_v: float

    def __post_init__(self) -> None:
        """Refuse what cannot be an amplifier."""
        for name, value in vars(self).items():
            if not (math.isfinite(value) and value > 0.0):
                raise ValueError(f"amplifier {name} must be a finite number > 0, not {value!r}")


class AnalogAmplifier:
    """An amplifier with an optional enable line and an optional voltage monitor."""

    def __init__(
        self, settings: AmplifierSettings, enable: DigitalOutput | None, voltage_monitor: AnalogInput | None
    ) -> None:
        self.settings = settings
        self._enable_line = enable
        self._voltage_monitor = voltage_monitor

    @property
    def state(self) -> AmplifierState:
        """What the enable line says now; UNKNOWN when it is absent or cannot be read. Never raises."""
        if self._enable_line is None:
            return AmplifierState.UNKNOWN
        try:
            return AmplifierState.ENABLED if self._enable_line.read() else AmplifierState.DISABLED
        except DeviceError:
            return AmplifierState.UNKNOWN

    def enable(self) -> AmplifierState:
        """Raise the enable line, if there is one, and return the state read back. Raises DeviceError."""
        if self._enable_line is not None:
            self._enable_line.write(True)
        return self.state

    def disable(self) -> AmplifierState:
        """Drop the enable line, if there is one, and return the state read back. Never raises."""
        if self._enable_line is not None:
            try:
                self._enable_line.write(False)
            except DeviceError:
                return AmplifierState.UNKNOWN
        return self.state

    def monitor_voltage_v(self) -> float | None:
        """Return the voltage at the electrode by the monitor, V; None when absent or unreadable. Never raises."""
        if self._voltage_monitor is None:
            return None
        try:
            reading_v = self._voltage_monitor.read_v()
        except DeviceError:
            return None
        return reading_v / self.settings.voltage_monitor_v_per_v if math.isfinite(reading_v) else None

    def check_drive(self, frequency_hz: float, voltage_v: float, current_peak_a: float) -> None:
        """Raise LimitExceeded unless the amplifier can follow a sine of peak `voltage_v` and `current_peak_a`.

        The slew rate of a sine is 2 pi f V.
        """
        for what, value, limit, unit in (
            ("voltage", voltage_v, self.settings.voltage_limit_v, "V"),
            ("current", current_peak_a, self.settings.current_limit_a, "A"),
            ("slew rate", 2.0 * math.pi * frequency_hz * voltage_v, self.settings.slew_limit_v_per_s, "V/s"),
        ):
            if not abs(value) <= limit:
                raise LimitExceeded(
                    f"amplifier: a peak {what} of {value:g} {unit} is beyond its limit of {limit:g} {unit}",
                    "lower the voltage or the frequency",
                )
