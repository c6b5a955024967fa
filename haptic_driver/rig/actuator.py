"""What brings commands to the electrode: set points over SCPI, or an analog envelope on a steady carrier."""

from __future__ import annotations

from abc import ABC, abstractmethod
from contextlib import suppress
from math import nan

import numpy as np

from haptic_driver.errors import HapticError
from haptic_driver.render.envelope import synthesise
from haptic_driver.rig.config import RigConfig
from haptic_driver.rig.devices import modulation_input
from haptic_driver.rig.evidence import OffEvidence
from haptic_driver.rig.parts.analog_outputs import NoAnalogOutput, SoundAnalogOutputConfig
from haptic_driver.rig.rig import Rig
from haptic_driver.signals import Course, DriveCommand
from hw.analog.output import AnalogOutput, OutputUnderrun
from hw.errors import DeviceError
from hw.generator.settings import ModulationInput

ENVELOPE_RATE_HZ = 50e3  # at most; slower outputs play at their own limit


class Actuator(ABC):
    """One way to the electrode, between a rig's `connect` and `close`.

    `name` is what `haptic status` says; `underruns` counts gaps, at zero, in what `play` brings out. `command` and
    `play` are for one thread each, `off` for any. All but `off` raise HapticError, after switching off.
    """

    name: str

    def __init__(self, rig: Rig) -> None:
        self.rig = rig
        self.underruns = 0

    @abstractmethod
    def command(self, time_s: float, command: DriveCommand) -> None:
        """Bring the newest command to the generator, at the rig's bounded rate; refreshes the lease.

        Takes as long as the dialogue with the instruments.
        """

    def play(self, command: DriveCommand, course: Course) -> None:  # noqa: B027 - an actuator may have nothing fast
        """Bring out, without waiting for the generator, what goes beside it; to be called every millisecond.

        `course`: what voltages have been asked for since the last call; none goes out where the command has no output.
        """

    def off(self) -> OffEvidence:
        """Off at once, from any thread; never raises."""
        return self.rig.off()


class SetpointActuator(Actuator):
    """Amplitudes over SCPI: the newest command at the rig's bounded rate."""

    name = "setpoints over SCPI"

    def command(self, time_s: float, command: DriveCommand) -> None:
        """The command itself."""
        self.rig.command(time_s, command)


class EnvelopeActuator(Actuator):
    """A carrier of `full_scale_v` over SCPI, and its amplitude by an analog output on Modulation In.

    `rig` is modulated; `output` is open, with the level that stands for no amplitude as its zero level. Every `play`
    adds its course to the output's stream, straight in voltage squared, which force follows. The stream is kept about
    `lead_s` long: so late is its end at the electrode, and so late may a `play` be. The output's own clock paces it;
    courses are a sample longer or shorter when need be. Without anything new the last voltage is held. A stream that
    runs dry is zero, counted in `underruns`, and begins again from zero. Until SCPI has brought another carrier no
    course rises: nobody has asked what its voltages may be at the present one.
    """

    name = "analog envelope"

    def __init__(
        self, rig: Rig, output: AnalogOutput, modulation: ModulationInput, full_scale_v: float, *,
        sample_rate_hz: float, lead_s: float,
    ) -> None:  # fmt: skip
        super().__init__(rig)
        self._output = output
        self._modulation = modulation
        self._full_scale_v = full_scale_v
        self._rate_hz = sample_rate_hz
        self._lead_s = lead_s
        self._power_v2 = 0.0  # where the stream ends
        self._carrier_hz = nan  # the one that is out
        self._resting = False

    def command(self, time_s: float, command: DriveCommand) -> None:
        """The carrier, at its highest as long as output is on; the amplitude is `play`'s."""
        self.rig.command(time_s, command._replace(voltage_v=self._full_scale_v if command.output_on else 0.0))
        if command.output_on:
            self._carrier_hz = command.frequency_hz

    def play(self, command: DriveCommand, course: Course) -> None:
        """Go on with the envelope; zero amplitude at once when the output is off."""
        if not command.output_on:
            self._rest()
            return
        highest_v2 = float(course.powers_v2.max(initial=0.0))
        if not highest_v2 <= self._full_scale_v**2:
            evidence = self.off()
            raise HapticError(
                "beyond_full_scale",
                f"{highest_v2**0.5:g} V does not fit a carrier of {self._full_scale_v:g} V (output: {evidence})",
                "the stages before it should not have asked for that; look at the rig's limits",
            )
        if command.frequency_hz != self._carrier_hz:
            course = course._replace(powers_v2=np.minimum(course.powers_v2, self._power_v2))
        try:
            self._go_on(course)
        except OutputUnderrun:
            self.underruns += 1
            self._power_v2 = 0.0
        except DeviceError as error:
            evidence = self.off()
            raise HapticError(error.code, f"{error.message} (output: {evidence})", error.hint) from error

    def off(self) -> OffEvidence:
        """The rig's lines first, which are fast; then the envelope."""
        evidence = self.rig.off()
        with suppress(DeviceError):  # it tries again by itself, and without a carrier it does nothing
            self._output.zero()
        return evidence

    def _go_on(self, course: Course) -> None:
        waiting_s = self._output.buffered_s
        samples = self._length(course.span_s, waiting_s)
        if samples < 1:
            return
        begin_v2 = self._power_v2 if waiting_s > 0.0 else 0.0
        powers_v2 = np.concatenate(((begin_v2,), course.powers_v2 if course.span_s > 0.0 else (begin_v2,)))
        envelope_v = np.empty(samples)
        synthesise(powers_v2, envelope_v)
        share = np.minimum(envelope_v / self._full_scale_v, 1.0)  # a root of a square may be larger by rounding
        self._resting = False
        self._output.write(self._modulation.full_scale_v * (2.0 * share - 1.0), self._rate_hz)
        self._power_v2 = powers_v2.item(-1)

    def _length(self, span_s: float, waiting_s: float) -> int:
        """How many samples of the stream a course takes; not all that is missing, or a late thread would bend it."""
        short_s = self._lead_s - waiting_s - span_s
        if waiting_s <= 0.0 or abs(short_s) > 0.5 * self._lead_s:
            return round((self._lead_s - waiting_s) * self._rate_hz)
        samples = round(span_s * self._rate_hz)
        if samples and abs(short_s) > 0.125 * self._lead_s:
            samples += 1 if short_s > 0.0 else -1
        return samples

    def _rest(self) -> None:
        if not self._resting:
            self._power_v2 = 0.0
            with suppress(DeviceError):  # as in `off`
                self._output.zero()
                self._resting = True


def make_actuator(config: RigConfig, rig: Rig, output: AnalogOutput | None) -> Actuator:
    """The way to the electrode that a rig's file describes; `output` is its analog output, if it has one."""
    modulation, analog = modulation_input(config), config.analog_output
    if output is None or modulation is None or isinstance(analog, NoAnalogOutput):
        return SetpointActuator(rig)
    own_hz = analog.sample_rate_hz if isinstance(analog, SoundAnalogOutputConfig) else analog.sample_rate_limit_hz
    return EnvelopeActuator(
        rig, output, modulation, config.limits.voltage_v,
        sample_rate_hz=own_hz if isinstance(analog, SoundAnalogOutputConfig) else min(own_hz, ENVELOPE_RATE_HZ),
        lead_s=analog.lead_s,
    )  # fmt: skip


def actuator_name(config: RigConfig) -> str:
    """What `haptic status` says of the way to the electrode."""
    return (SetpointActuator if isinstance(config.analog_output, NoAnalogOutput) else EnvelopeActuator).name
