"""Kinds of amplifiers."""

from __future__ import annotations

from contextlib import closing
from dataclasses import replace
from math import inf
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import Field

from haptic_driver.base.units import readable
from haptic_driver.config import Within
from haptic_driver.rig.check import Checks, Examination
from haptic_driver.rig.part import (
    MONITORS,
    MonitorHertz,
    MonitorNoise,
    Part,
    PartSection,
    SignedFigures,
    Wiring,
)

if TYPE_CHECKING:
    from hw.amplifier.analog import AnalogAmplifier
    from hw.analog.ni_daq import NiDigitalInput
    from hw.monitor.lines import MonitorLines


class AmplifierConfig(SignedFigures, PartSection):
    """A high-voltage amplifier; peak values at the electrode. Lines are channels of a card, absent
    if not named.

    A monitor's bandwidth is that of a first-order low-pass, its noise the standard deviation on the
    line.
    """

    kind: str = "analog"
    gain_v_per_v: Annotated[
        float,
        Within(
            0.1,
            1e4,
            "nothing that drives an electrode weakens its input to less, or strengthens it so much",
        ),
    ] = Field(description="volts at the electrode per volt at the input")
    voltage_limit_v: Annotated[
        float, Within(1.0, 50e3, "no amplifier drives an electrode with less or more")
    ] = Field(description="peak")
    current_limit_a: Annotated[
        float,
        Within(
            1e-4,
            10.0,
            "less does not charge 100 pF to 100 V at 1.6 kHz; no high voltage comes with more",
        ),
    ] = Field(description="peak")
    slew_limit_v_per_s: Annotated[
        float, Within(1.0, 1e11, "no high-voltage amplifier is slower or faster")
    ] = Field(description="2 pi f V of a sine must stay below")
    voltage_monitor_v_per_v: Annotated[
        float,
        Within(
            1e-5,
            1.0,
            "no monitor line has more than the electrode, or so little that it reads as nothing",
        ),
    ] = Field(default=0.01, description="volts at the monitor output per volt at the electrode")
    current_monitor_v_per_a: Annotated[
        float, Within(1e-3, 1e6, "no current monitor tells an ampere by less or more")
    ] = Field(default=1.0, description="volts at the monitor output per ampere")
    voltage_monitor_bandwidth_hz: MonitorHertz | None = Field(
        default=None,
        description=(
            "corner of the monitor, a first-order low-pass; it is taken out of what is read"
        ),
    )
    current_monitor_bandwidth_hz: MonitorHertz | None = Field(default=None, description="likewise")
    voltage_monitor_noise_v: MonitorNoise = Field(
        default=0.0, description="1 sigma on the line, of a simulated rig"
    )
    current_monitor_noise_v: MonitorNoise = Field(default=0.0, description="likewise")
    fault_level: bool = Field(
        default=True, description="level of the fault line that means a fault"
    )
    voltage_monitor: str | None = Field(
        default=None,
        description="analog input that reads the voltage monitor; leave it out if there is none",
    )
    current_monitor: str | None = Field(default=None, description="likewise")
    fault_line: str | None = Field(
        default=None,
        description="digital input that reads the fault line; leave it out if there is none",
    )

    @property
    def is_simulated(self) -> None:
        """It has no dialogue: a simulated one has the same figures."""

    @property
    def channels(self) -> list[str]:
        return [channel for channel in (self.voltage_monitor, self.current_monitor) if channel]

    @property
    def monitors(self) -> dict[str, str]:
        said = self.voltage_monitor, self.current_monitor, self.fault_line
        return {name: where for name, where in zip(MONITORS, said, strict=True) if where}

    def monitor_lines(self) -> MonitorLines:
        """What the monitors do to voltage and current."""
        from hw.monitor.lines import MonitorLines

        return MonitorLines(
            self.voltage_monitor_v_per_v,
            self.current_monitor_v_per_a,
            self.voltage_monitor_bandwidth_hz or inf,
            self.current_monitor_bandwidth_hz or inf,
        )

    def wire(self, wiring: Wiring) -> Wiring:
        """Its monitors, where the card reads them, and what they do to voltage and current."""
        voltage, current = (
            None if channel is None else wiring.peak(channel)
            for channel in (self.voltage_monitor, self.current_monitor)
        )
        return replace(
            wiring,
            voltage_monitor=voltage or wiring.voltage_monitor,
            current_monitor=current or wiring.current_monitor,
            monitor_lines=self.monitor_lines(),
            monitor_channels=self.channels,
        )

    def fault(self) -> NiDigitalInput | None:
        """Its fault line, not open."""
        from hw.analog.ni_daq import NiDigitalInput

        return None if self.fault_line is None else NiDigitalInput(self.fault_line)

    def examine(self, at: Examination) -> Checks:
        """Look at its lines: it has no dialogue."""
        yield at.unverified(
            f"gain {self.gain_v_per_v:g}, {self.voltage_limit_v:g} V,"
            f" {readable(self.current_limit_a, 'A')},"
            f" {readable(self.slew_limit_v_per_s, 'V/s')}: it has no"
            " dialogue, and nothing is energised here",
            "compare one low voltage with a probe",
            self.untold("gain_v_per_v", "voltage_monitor_v_per_v", "current_monitor_v_per_a"),
        )
        yield from at.called("fault line").told(self._examine_fault_line)
        yield from at.called("voltage monitor").told(self._examine_monitor)

    def _examine_fault_line(self, at: Examination) -> Checks:
        fault = self.fault()
        if fault is None:
            yield at.unverified("there is none: a tripped amplifier shows on its monitor at best")
            return
        with closing(fault) as line:
            if line.read() is self.fault_level:
                yield at.failed("it says fault", "look at the amplifier; check fault_level")
            else:
                yield at.ok("no fault")

    def _examine_monitor(self, at: Examination) -> Checks:
        from haptic_driver.rig.evidence import MONITOR_QUIET_V

        channel, card = self.voltage_monitor, at.rig.analog_inputs
        if channel is None or card is None:
            yield at.unverified(
                "there is none: nothing sees the electrode, and off rests on what generator and"
                " enable line say",
                "wire the amplifier's monitor to an analog input",
            )
            return
        with closing(card.inputs([channel])) as inputs:
            inputs.open()
            line = card.wire(Wiring(inputs=inputs)).peak(channel)
            assert line is not None  # there are inputs
            electrode_v = line.read_v() / self.voltage_monitor_v_per_v
            said, held = f"peak {electrode_v:.3g} V at the electrode", inputs.held()
            if electrode_v <= MONITOR_QUIET_V:
                yield at.ok(said, held)
            else:
                yield at.failed(said, "something drives it", held)
            hint = "compare one low voltage with a probe"
            yield at.called("monitor scale").unverified("needs a voltage", hint)


class AnalogAmplifierConfig(AmplifierConfig):
    """An amplifier without a dialogue: an input, an enable line, monitors and a fault line, each
    where it has one.
    """

    kind: Literal["analog"] = "analog"

    def make(self, wiring: Wiring) -> Part[AnalogAmplifier]:
        from hw.amplifier.analog import AmplifierSettings, AnalogAmplifier

        fault = self.fault()
        amplifier = AnalogAmplifier(
            AmplifierSettings(**self.given_for(AmplifierSettings)),
            wiring.enable,
            wiring.voltage_monitor,
            current_monitor=wiring.current_monitor,
            fault=fault or wiring.fault,
        )
        return Part(amplifier, [fault.open], [fault.close]) if fault else Part(amplifier)
