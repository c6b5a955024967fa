"""Kinds of amplifiers."""

from __future__ import annotations

from math import inf
from typing import TYPE_CHECKING, Literal

from haptic_driver.rig.part import NotNegative, Part, PartKind, PartSection, Positive, Vouched, Wiring

if TYPE_CHECKING:
    from hw.amplifier.analog import AnalogAmplifier
    from hw.monitor.lines import MonitorLines


class AmplifierConfig(Vouched, PartSection):
    """A high-voltage amplifier; peak values at the electrode. Lines are channels of a card, absent if not named.

    A monitor's bandwidth is that of a first-order low-pass, its noise the standard deviation on the line.
    """

    kind: str = "analog"
    gain_v_per_v: Positive
    voltage_limit_v: Positive
    current_limit_a: Positive
    slew_limit_v_per_s: Positive
    voltage_monitor_v_per_v: Positive = 0.01
    current_monitor_v_per_a: Positive = 1.0
    voltage_monitor_bandwidth_hz: Positive | None = None
    current_monitor_bandwidth_hz: Positive | None = None
    voltage_monitor_noise_v: NotNegative = 0.0
    current_monitor_noise_v: NotNegative = 0.0
    fault_level: bool = True
    voltage_monitor: str | None = None
    current_monitor: str | None = None
    fault_line: str | None = None

    @property
    def channels(self) -> list[str]:
        """The monitors."""
        return [channel for channel in (self.voltage_monitor, self.current_monitor) if channel]

    def monitor_lines(self) -> MonitorLines:
        """What the monitors do to voltage and current."""
        from hw.monitor.lines import MonitorLines

        return MonitorLines(
            self.voltage_monitor_v_per_v,
            self.current_monitor_v_per_a,
            self.voltage_monitor_bandwidth_hz or inf,
            self.current_monitor_bandwidth_hz or inf,
        )


class AnalogAmplifierConfig(AmplifierConfig):
    """An amplifier without a dialogue: an input, an enable line, monitors and a fault line, each where it has one."""

    kind: Literal["analog"] = "analog"


def make_analog(section: AmplifierConfig, wiring: Wiring) -> Part[AnalogAmplifier]:
    """See `hw.amplifier.analog`."""
    from hw.amplifier.analog import AmplifierSettings, AnalogAmplifier

    amplifier = AnalogAmplifier(
        AmplifierSettings(**section.given_for(AmplifierSettings)),
        wiring.enable,
        wiring.voltage_monitor,
        current_monitor=wiring.current_monitor,
        fault=wiring.fault,
    )
    return Part(amplifier)


ANALOG = PartKind(AnalogAmplifierConfig, make_analog)
