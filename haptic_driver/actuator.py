"""What brings commands to the electrode: set points over SCPI, or an analog envelope on a steady carrier."""

from __future__ import annotations

from abc import ABC, abstractmethod
from contextlib import suppress
from typing import Any

import numpy as np

from haptic_driver.errors import HapticError
from haptic_driver.rig import OffEvidence, Rig, RigState
from haptic_driver.signals import DriveCommand, EnvelopeBlock
from hw.analog_output import AnalogOutput, OutputUnderrun
from hw.errors import DeviceError
from hw.generator_settings import ExternalModulation, ModulationInput
from hw.waveform_generator import Agilent33220A

MONITOR_OF_AN_ENVELOPE = 1.0  # the least `monitor_tolerance` under which a rig takes silence for a possible envelope


class Actuator(ABC):
    """One way to the electrode, between a rig's `connect` and `close`. Not thread-safe but for `off`, which is.

    `name` is what `haptic status` says. Every method but `off` raises HapticError, after switching off.
    """

    name: str

    def __init__(self, rig: Rig) -> None:
        self._rig = rig

    @abstractmethod
    def command(self, time_s: float, command: DriveCommand, envelope: EnvelopeBlock | None = None) -> None:
        """Bring one tick to the electrode; refreshes the lease. What it does not use of both, it ignores."""

    def watch(self, time_s: float) -> None:
        """Switch off what nobody refreshed; see `Rig.watch`."""
        self._rig.watch(time_s)

    def off(self) -> OffEvidence:
        """Off at once, from any thread; never raises."""
        return self._rig.off()

    def stop(self) -> OffEvidence:
        """A planned end; never raises."""
        return self._rig.stop()


class SetpointActuator(Actuator):
    """Amplitudes over SCPI: the newest command at the rig's bounded rate."""

    name = "setpoints over SCPI"

    def command(self, time_s: float, command: DriveCommand, envelope: EnvelopeBlock | None = None) -> None:
        """The command itself."""
        self._rig.command(time_s, command)


class EnvelopeCarrier(Agilent33220A):
    """The generator with its amplitude following Modulation In; set points are its highest voltage then."""

    def set_point(
        self, frequency_hz: float, voltage_v: float, voltage_offset_v: float = 0.0, **how: Any
    ) -> None:  # fmt: skip
        """As ever, under external modulation."""
        super().set_point(frequency_hz, voltage_v, voltage_offset_v, **(how | {"modulation": ExternalModulation()}))


class EnvelopeActuator(Actuator):
    """A carrier of `full_scale_v` over SCPI, and its amplitude within each tick by an analog output.

    `rig` has an `EnvelopeCarrier` and a `monitor_tolerance` of at least 1: the monitor sees what the envelope leaves of
    the carrier, so all that it can show is too much. `output` is open, on Modulation In, with the level that stands for
    no amplitude as its zero level. `lead_s` of zero amplitude goes before a stream, so that a tick may be late by so
    much; it is delay, and belongs into the rig's `latency_s`. A stream that runs dry is zero, counted in `underruns`,
    and begins again; blocks for which there is no room, since the clocks differ, are left out and counted in `dropped`.
    """

    name = "analog envelope"

    def __init__(
        self,
        rig: Rig,
        output: AnalogOutput,
        modulation: ModulationInput,
        full_scale_v: float,
        *,
        sample_rate_hz: float = 50e3,
        lead_s: float = 0.005,
    ) -> None:
        super().__init__(rig)
        zero_v, needed = modulation.input_v(0.0), rig.safety.monitor_tolerance
        if abs(output.settings.zero_level_v - zero_v) > 1e-6:
            raise HapticError(
                "bad_actuator", f"{output.resource} rests at {output.settings.zero_level_v:g} V, where the generator "
                f"takes {zero_v:g} V for no amplitude", "set its zero level to that",
            )  # fmt: skip
        if needed < MONITOR_OF_AN_ENVELOPE:
            raise HapticError(
                "bad_actuator", f"a monitor within {needed:g} of the carrier would trip at every trough of an envelope",
                f"set monitor_tolerance to {MONITOR_OF_AN_ENVELOPE:g}",
            )  # fmt: skip
        self.underruns = self.dropped = 0
        self._output = output
        self._modulation = modulation
        self._full_scale_v = full_scale_v
        self._rate_hz = sample_rate_hz
        self._lead_s = lead_s

    def command(self, time_s: float, command: DriveCommand, envelope: EnvelopeBlock | None = None) -> None:
        """The block that belongs to this tick; zero amplitude before the carrier comes on and before it goes."""
        on = envelope is not None and envelope.output_on
        with_carrier = DriveCommand(command.frequency_hz, self._full_scale_v if on else 0.0, on)
        try:
            if not on or self._rig.state is not RigState.ON:
                self._output.zero()
            self._rig.command(time_s, with_carrier)
            if envelope is not None and on and self._rig.state is RigState.ON:
                self._play(envelope)
        except DeviceError as error:
            evidence = self.off()
            raise HapticError(error.code, f"{error.message} (output: {evidence})", error.hint) from error

    def off(self) -> OffEvidence:
        """The rig's lines first, which are fast; then the envelope."""
        evidence = self._rig.off()
        self._rest()
        return evidence

    def stop(self) -> OffEvidence:
        """Amplitude to zero, then the carrier."""
        self._rest()
        return self._rig.stop()

    def _play(self, envelope: EnvelopeBlock) -> None:
        share = envelope.voltage_v / self._full_scale_v
        if not (share.min() >= 0.0 and share.max() <= 1.0):
            evidence = self.off()
            raise HapticError(
                "beyond_full_scale",
                f"an envelope of {envelope.voltage_v.max():g} V does not fit a carrier of {self._full_scale_v:g} V "
                f"(output: {evidence})", "raise full_scale_v, or lower the rig's voltage limit to it",
            )  # fmt: skip
        levels_v = self._modulation.full_scale_v * (2.0 * share - 1.0)
        if self._output.buffered_s + levels_v.size / self._rate_hz > self._output.settings.buffer_s:
            self.dropped += 1
            return
        try:
            self._output.check()
        except OutputUnderrun:
            self.underruns += 1
        if self._output.buffered_s == 0.0:
            lead = np.full(round(self._lead_s * self._rate_hz), self._output.settings.zero_level_v)
            levels_v = np.concatenate((lead, levels_v))
        self._output.write(levels_v, self._rate_hz)

    def _rest(self) -> None:
        with suppress(DeviceError):  # the rig goes off all the same, and the output tries again by itself
            self._output.zero()
