"""What brings commands to the generator: set points over SCPI, or the carrier of an analog
envelope.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from math import inf, nan

from haptic_driver.rig.config import RigConfig
from haptic_driver.rig.evidence import KnownOutput
from haptic_driver.rig.part import NoPart
from haptic_driver.rig.rig import Rig
from haptic_driver.rig.states import RigState
from haptic_driver.signals import DriveCommand


class Actuator(ABC):
    """One way to the generator, between a rig's `connect` and `close`.

    While a command asks for output the generator stays on, at its lowest level where less is asked
    for. Switching takes longer than a thread of a texture, and a relay lasts for a limited number
    of switchings. `switched` counts how often it came on; that happens at most every
    `relay_interval_s`. Off is never kept waiting. `name` is what `haptic status` says. `command` is
    for one thread and raises HapticError, after switching off; `off` is for any.
    """

    name: str

    def __init__(self, rig: Rig, relay_interval_s: float) -> None:
        self.rig = rig
        self.relay_interval_s = relay_interval_s
        self.switched = 0
        self._came_on_s = -inf

    def command(self, time_s: float, command: DriveCommand) -> None:
        """Bring the newest command to the generator, at the rig's bounded rate; refreshes the
        lease.

        Takes as long as the dialogue with the instruments.
        """
        was_on = self.rig.state is RigState.ON
        if not was_on and command.output_on and time_s - self._came_on_s < self.relay_interval_s:
            command = command._replace(output_on=False)
        self.rig.command(time_s, self._set_point(command))
        if not was_on and self.rig.state is RigState.ON:
            self.switched += 1
            self._came_on_s = time_s

    def off(self) -> KnownOutput:
        """Off at once, from any thread; never raises."""
        return self.rig.off()

    @property
    def carrier_hz(self) -> float:
        """The carrier to which an envelope belongs; NaN where there is none."""
        return nan

    @property
    def full_scale_v(self) -> float:
        """Peak voltage at the electrode where an envelope is at its highest."""
        return 0.0

    @abstractmethod
    def _set_point(self, command: DriveCommand) -> DriveCommand:
        """The orders to the generator."""


class SetpointActuator(Actuator):
    """Amplitudes over SCPI: the newest command at the rig's bounded rate."""

    name = "setpoints over SCPI"

    def _set_point(self, command: DriveCommand) -> DriveCommand:
        voltage_v = max(command.voltage_v, self.rig.minimum_voltage_v) if command.output_on else 0.0
        return command._replace(voltage_v=voltage_v)


class SampleActuator(SetpointActuator):
    """Amplitudes as samples of the output that makes the carrier too."""

    name = "carrier and envelope as samples"


class CarrierActuator(Actuator):
    """A carrier over SCPI at the highest amplitude that is allowed there, which an envelope takes
    down.

    Until SCPI has brought another carrier no envelope may rise: nobody has asked what its voltages
    may be at the present one.
    """

    name = "analog envelope"

    def __init__(self, rig: Rig, relay_interval_s: float, limit_v: float) -> None:
        super().__init__(rig, relay_interval_s)
        self._limit_v = limit_v

    @property
    def carrier_hz(self) -> float:
        """The carrier that is out."""
        return self.rig.carrier[0]

    @property
    def full_scale_v(self) -> float:
        """The carrier's own voltage."""
        return self.rig.carrier[1]

    def _set_point(self, command: DriveCommand) -> DriveCommand:
        return command._replace(
            voltage_v=min(command.full_scale_v, self._limit_v) if command.output_on else 0.0
        )


def make_actuator(config: RigConfig, rig: Rig) -> Actuator:
    """The way to the generator that a rig's file describes."""
    relay_interval_s = config.generator_kind().relay_interval_s
    if not isinstance(config.analog_output, NoPart):
        return CarrierActuator(rig, relay_interval_s, config.limits.voltage_v)
    kind = SetpointActuator if config.waveform_generator.carrier is None else SampleActuator
    return kind(rig, relay_interval_s)


def actuator_name(config: RigConfig) -> str:
    """What `haptic status` says of the way to the electrode."""
    if not isinstance(config.analog_output, NoPart):
        return CarrierActuator.name
    kind = SetpointActuator if config.waveform_generator.carrier is None else SampleActuator
    return kind.name
