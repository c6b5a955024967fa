"""A rig: configuration -> devices, and the one place where device words become signals and back."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from math import pi

from haptic_driver.config import RigConfig
from haptic_driver.errors import HapticError
from haptic_driver.signals import DriveCommand
from hw.amplifier import AmplifierSettings, AmplifierState, AnalogAmplifier, AnalogInput, DigitalOutput
from hw.errors import DeviceError
from hw.force_sensor import ForceReading, ForceSensor
from hw.transport.contract import Transport
from hw.waveform_generator import Agilent33220A, GeneratorSettings

MONITOR_QUIET_V = 5.0  # at the electrode; what a monitor may read without anything being on


@dataclass(frozen=True)
class OffEvidence:
    """What is known about the output after switching it off; None where nothing could be learnt."""

    generator_off: bool | None
    amplifier: AmplifierState
    monitor_v: float | None

    @property
    def output_on(self) -> bool | None:
        """False only with evidence: generator or enable line say off, and the monitor does not see a voltage."""
        if self.monitor_v is not None and self.monitor_v > MONITOR_QUIET_V:
            return True
        if self.generator_off or self.amplifier is AmplifierState.DISABLED:
            return False
        return None if self.generator_off is None else True

    def __str__(self) -> str:
        """For a person."""
        generator = {True: "generator says off", False: "generator says ON", None: "generator does not answer"}
        monitor = "no monitor" if self.monitor_v is None else f"monitor reads {self.monitor_v:.3g} V"
        return f"{generator[self.generator_off]}, amplifier {self.amplifier.value}, {monitor}"


class Rig:
    """The devices of one rig behind the two words that rendering needs: `command` and `read_force`.

    Amplitudes go out over SCPI, which is slow: at most one set point per `setpoint_interval_s`, the newest; switching
    off never waits. Every failure of a device switches off first and is then raised as HapticError.
    """

    def __init__(
        self, config: RigConfig, generator: Agilent33220A, amplifier: AnalogAmplifier, force_sensor: ForceSensor
    ) -> None:
        self._generator = generator
        self._amplifier = amplifier
        self._force_sensor = force_sensor
        self._interval_s = config.output.setpoint_interval_s
        self._panel_capacitance_f = config.limits.panel_capacitance_f
        self._written_s: float | None = None
        self._on = False

    def connect(self) -> None:
        """Identify and set up the generator with its output off and the amplifier disabled."""
        with self._safe():
            self._amplifier.disable()
            self._generator.connect()

    def command(self, time_s: float, command: DriveCommand) -> None:
        """Bring `command` to the electrode, now or with the next set point. `time_s` is the caller's clock."""
        if not command.output_on or command.voltage_v < self._generator.minimum_voltage_v:
            if self._on:
                self.off()
            return
        due = self._written_s is None or time_s - self._written_s >= self._interval_s * (1.0 - 1e-6)
        if self._on and not due:
            return
        panel_current_a = 2.0 * pi * command.frequency_hz * command.voltage_v * self._panel_capacitance_f
        with self._safe():
            self._amplifier.check_drive(command.frequency_hz, command.voltage_v, panel_current_a)
            self._generator.set_point(command.frequency_hz, command.voltage_v)
            self._written_s = time_s
            if not self._on:
                self._on = True
                self._generator.set_output(True)
                self._amplifier.enable()

    def read_force(self) -> ForceReading:
        """The force sensor's present reading."""
        with self._safe():
            return self._force_sensor.read()

    def off(self) -> OffEvidence:
        """Amplifier disabled first, since its line is fast; then the generator. Never raises; says what is known."""
        self._amplifier.disable()
        generator_off = self._generator.off()
        self._on, self._written_s = False, None
        return OffEvidence(generator_off, self._amplifier.state, self._amplifier.monitor_voltage_v())

    def close(self) -> OffEvidence:
        """Switch off, hang up, and return what is known about the output."""
        evidence = self.off()
        self._generator.close()
        return evidence

    @contextmanager
    def _safe(self) -> Iterator[None]:
        try:
            yield
        except DeviceError as error:
            evidence = self.off()
            raise HapticError(error.code, f"{error.message} (output: {evidence})", error.hint) from error


def build_rig(
    config: RigConfig,
    transport: Transport,
    force_sensor: ForceSensor,
    enable: DigitalOutput | None,
    voltage_monitor: AnalogInput | None,
) -> Rig:
    """The devices of `config` on the given lines; nothing is opened yet."""
    amplifier = config.amplifier
    generator = Agilent33220A(
        transport,
        GeneratorSettings(
            volts_per_volt=amplifier.gain_v_per_v,
            voltage_limit_v=config.limits.voltage_v,
            frequency_low_hz=config.limits.frequency_hz[0],
            frequency_high_hz=config.limits.frequency_hz[1],
            reply_timeout_s=config.waveform_generator.reply_timeout_s,
        ),
    )
    settings = AmplifierSettings(
        gain_v_per_v=amplifier.gain_v_per_v,
        voltage_limit_v=amplifier.voltage_limit_v,
        current_limit_a=amplifier.current_limit_a,
        slew_limit_v_per_s=amplifier.slew_limit_v_per_s,
        voltage_monitor_v_per_v=amplifier.voltage_monitor_v_per_v,
    )
    return Rig(config, generator, AnalogAmplifier(settings, enable, voltage_monitor), force_sensor)
