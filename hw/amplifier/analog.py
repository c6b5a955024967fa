"""The high-voltage amplifier: a box with a few lines, any of which may be absent."""

from __future__ import annotations

import enum
import math
from contextlib import suppress
from dataclasses import dataclass

from hw.analog.lines import AnalogInput, DigitalInput, DigitalOutput
from hw.errors import DeviceError, LimitExceeded


class AmplifierState(enum.Enum):
    """What is known about the high voltage; only DISABLED is evidence that there is none."""

    ENABLED = "enabled"
    DISABLED = "disabled"
    TRIPPED = "tripped"
    UNKNOWN = "unknown"


@dataclass(frozen=True)
class AmplifierSettings:
    """What the amplifier is and may do, as measured or from its data sheet.

    Voltages and currents are peak values at the electrode. `voltage_monitor_v_per_v` is volts at
    the monitor output per volt at the electrode (0.01 for 1 V per 100 V). `current_monitor_v_per_a`
    is volts per ampere likewise. `fault_level` is the level of the fault line that means a fault.
    Raises ValueError unless all figures are > 0.
    """

    gain_v_per_v: float
    voltage_limit_v: float
    current_limit_a: float
    slew_limit_v_per_s: float
    voltage_monitor_v_per_v: float
    current_monitor_v_per_a: float = 1.0
    fault_level: bool = True

    def __post_init__(self) -> None:
        """Refuse what cannot be an amplifier."""
        for name, value in vars(self).items():
            if name != "fault_level" and not (math.isfinite(value) and value > 0.0):
                raise ValueError(f"amplifier {name} must be a finite number > 0, not {value!r}")


class AnalogAmplifier:
    """An amplifier with an optional enable line, fault line, voltage monitor and current monitor.

    A line that is absent or cannot be read makes what it would tell unknown: None, or
    AmplifierState.UNKNOWN. Each method takes at most the timeouts of the lines it uses.
    """

    def __init__(
        self,
        settings: AmplifierSettings,
        enable: DigitalOutput | None,
        voltage_monitor: AnalogInput | None,
        *,
        current_monitor: AnalogInput | None = None,
        fault: DigitalInput | None = None,
    ) -> None:
        self.settings = settings
        self._enable_line = enable
        self._voltage_monitor = voltage_monitor
        self._current_monitor = current_monitor
        self._fault_line = fault
        self.seen_voltage_v: float | None = None  # by the monitors, when they were read last
        self.seen_current_a: float | None = None

    @property
    def state(self) -> AmplifierState:
        """What the lines say now; never raises.

        A low enable line is DISABLED whatever the others say. Otherwise a fault is TRIPPED: it may
        or may not have taken the voltage away. A high enable line is ENABLED unless a fault line is
        there and dead.
        """
        enabled = _level(self._enable_line)
        if enabled is False:
            return AmplifierState.DISABLED
        fault = self.fault
        if fault:
            return AmplifierState.TRIPPED
        if enabled and (self._fault_line is None or fault is False):
            return AmplifierState.ENABLED
        return AmplifierState.UNKNOWN

    @property
    def fault(self) -> bool | None:
        """Whether the fault line says fault; None when absent or unreadable. Never raises."""
        level = _level(self._fault_line)
        return None if level is None else level is self.settings.fault_level

    def enable(self) -> AmplifierState:
        """Raise the enable line, if there is one, and return the state read back. Raises
        DeviceError.
        """
        if self._enable_line is not None:
            self._enable_line.write(True)
        return self.state

    def disable(self) -> AmplifierState:
        """Drop the enable line, if there is one, and return the state read back. Never raises.

        The level counts, not the order: a line that took no order but reads low is low.
        """
        if self._enable_line is not None:
            with suppress(DeviceError):
                self._enable_line.write(False)
        return self.state

    def monitor_voltage_v(self) -> float | None:
        """Return the voltage at the electrode by the monitor, V; None when absent or unreadable.
        Never raises.
        """
        said_v = _scaled(self._voltage_monitor, self.settings.voltage_monitor_v_per_v)
        self.seen_voltage_v = said_v
        return said_v

    def monitor_current_a(self) -> float | None:
        """Return the output current by the monitor, A; None when absent or unreadable. Never
        raises.
        """
        said_a = _scaled(self._current_monitor, self.settings.current_monitor_v_per_a)
        self.seen_current_a = said_a
        return said_a

    def check_drive(self, frequency_hz: float, voltage_v: float, current_peak_a: float) -> None:
        """Raise LimitExceeded unless the amplifier can follow a sine of peak `voltage_v` and
        `current_peak_a`.

        The slew rate of a sine is 2 pi f V.
        """
        for what, value, limit, unit in (
            ("voltage", voltage_v, self.settings.voltage_limit_v, "V"),
            ("current", current_peak_a, self.settings.current_limit_a, "A"),
            (
                "slew rate",
                2.0 * math.pi * frequency_hz * voltage_v,
                self.settings.slew_limit_v_per_s,
                "V/s",
            ),
        ):
            if not abs(value) <= limit:
                raise LimitExceeded(
                    f"amplifier: a peak {what} of {value:g} {unit} is beyond its limit of {limit:g}"
                    f" {unit}",
                    "lower the voltage or the frequency",
                )


def _level(line: DigitalInput | None) -> bool | None:
    if line is None:
        return None
    try:
        return line.read()
    except DeviceError:
        return None


def _scaled(monitor: AnalogInput | None, volts_per_unit: float) -> float | None:
    if monitor is None:
        return None
    try:
        reading_v = monitor.read_v()
    except DeviceError:
        return None
    return reading_v / volts_per_unit if math.isfinite(reading_v) else None
