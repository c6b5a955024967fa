"""Kinds of amplifiers."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

from haptic_driver.rig.part import Part, PartKind, PartSection, Positive, Vouched, Wiring

if TYPE_CHECKING:
    from hw.amplifier.analog import AnalogAmplifier


class AmplifierConfig(Vouched, PartSection):
    """A high-voltage amplifier; peak values at the electrode. Lines are channels of a card, absent if not named."""

    kind: str = "analog"
    gain_v_per_v: Positive
    voltage_limit_v: Positive
    current_limit_a: Positive
    slew_limit_v_per_s: Positive
    voltage_monitor_v_per_v: Positive = 0.01
    current_monitor_v_per_a: Positive = 1.0
    fault_level: bool = True
    voltage_monitor: str | None = None
    current_monitor: str | None = None
    fault_line: str | None = None

    @property
    def channels(self) -> list[str]:
        """The monitors."""
        return [channel for channel in (self.voltage_monitor, self.current_monitor) if channel]


class AnalogAmplifierConfig(AmplifierConfig):
    """An amplifier without a dialogue: an input, an enable line, monitors and a fault line, each where it has one."""

    kind: Literal["analog"] = "analog"


def make_analog(section: AmplifierConfig, wiring: Wiring) -> Part[AnalogAmplifier]:
    """See `hw.amplifier.analog`."""
    from hw.amplifier.analog import AmplifierSettings, AnalogAmplifier

    settings = AmplifierSettings(
        gain_v_per_v=section.gain_v_per_v,
        voltage_limit_v=section.voltage_limit_v,
        current_limit_a=section.current_limit_a,
        slew_limit_v_per_s=section.slew_limit_v_per_s,
        voltage_monitor_v_per_v=section.voltage_monitor_v_per_v,
        current_monitor_v_per_a=section.current_monitor_v_per_a,
        fault_level=section.fault_level,
        measured_by=section.measured_by,
        measured_at="" if section.measured_at is None else section.measured_at.isoformat(),
    )
    return Part(
        AnalogAmplifier(
            settings,
            wiring.enable,
            wiring.voltage_monitor,
            current_monitor=wiring.current_monitor,
            fault=wiring.fault,
        )
    )


ANALOG = PartKind(AnalogAmplifierConfig, make_analog)
