"""From a rig's file to its devices: the drivers of everything it names, wired to one another, opened and closed.

Gauges and monitors share the one task that a card has for its inputs. Nothing here knows what is at the other end of a
resource; a simulated instrument behind the same name is driven the same way.
"""

from __future__ import annotations

import hashlib
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from math import ceil
from pathlib import Path
from types import TracebackType
from typing import Self

from haptic_driver.errors import BadInputError
from haptic_driver.rig import config as rig_config
from haptic_driver.rig.config import NO_WATCHDOG, RigConfig
from haptic_driver.rig.evidence import OffEvidence
from haptic_driver.rig.rig import Rig, build_rig
from haptic_driver.rig.slide import read_slide
from haptic_driver.rig.states import RigEvent
from hw.analog.lines import AnalogInput, DigitalInput, DigitalOutput, Heartbeat
from hw.analog.ni_daq import NiAnalogInput, NiAnalogInputs, NiAnalogOutput, NiDigitalInput, NiDigitalOutput
from hw.analog.output import AnalogOutput, AnalogOutputSettings
from hw.analog.sound_card import SoundCardOutput
from hw.errors import DeviceError
from hw.finger.touch_screen import TouchCalibration, open_touch_screen
from hw.finger.tracker import FingerTracker, RecordedFinger, StageFinger
from hw.force.ati_calibration import AtiCalibration
from hw.force.net_ft import NetFt, NetFtScale, NetFtSettings
from hw.force.sensor import ForceAxes, ForceSensor, GaugeForceSensor
from hw.safety.interlock import HeartbeatInterlock, ModemLine
from hw.safety.watchdog import Watchdog, WatchdogSettings
from hw.stage.lts150 import Lts150, StageSettings
from hw.transport.contract import Transport
from hw.transport.marker import scpi_marker
from hw.transport.resource import make_transport
from hw.transport.serial import SerialTransport

STAGE_INTERVAL_S = 0.005  # between questions for the stage's place


@dataclass(frozen=True)
class Devices:
    """Everything a rig has, closed; use `open` and `close`, or a `with` block.

    Devices open in an order in which nothing can come on before what switches it off is there: interlock, watchdog,
    envelope (at its zero level), generator (off and reset), sensors (which take their bias: leave the force sensor
    unloaded), stage. Closing switches off first. What was opened is closed again when something after it fails.
    """

    rig: Rig
    force_sensor: ForceSensor
    tracker: FingerTracker | None
    stage: Lts150 | None
    analog_output: AnalogOutput | None
    watchdog: Watchdog | None
    opening: Sequence[Callable[[], object]]
    closing: Sequence[Callable[[], object]]

    def open(self) -> None:
        """Open everything. Raises HapticError and DeviceError."""
        try:
            for step in self.opening:
                step()
        except BaseException:
            self.close()
            raise

    def close(self) -> OffEvidence:
        """Switch off, close everything, and return what is known about the output. Never raises DeviceError."""
        evidence = self.rig.close()
        for step in self.closing:
            with suppress(DeviceError):
                step()
        return evidence

    def __enter__(self) -> Self:
        """Open."""
        self.open()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close."""
        self.close()


def connect_devices(
    config: RigConfig, *, on_event: Callable[[RigEvent], None] = lambda event: None, transport: Transport | None = None
) -> Devices:
    """The drivers of the devices that `config` names; nothing is opened before the result is entered.

    With an analog output the generator's amplitude follows it. `transport` stands in for the generator's, e.g. one that
    records. Raises BadInputError for a rig without hardware.
    """
    if config.simulated:
        raise BadInputError("simulated", f"rig {config.name} is simulated", "use haptic_driver.simulation.rig")
    parts = _Parts(config)
    force_sensor = parts.force_sensor()
    stage = parts.stage()
    tracker = parts.tracker(stage)
    watchdog = parts.watchdog()
    enable, heartbeats = parts.interlock()
    output = parts.analog_output()
    rig = build_rig(
        config,
        transport or generator_transport(config),
        force_sensor,
        enable,
        parts.monitor(config.amplifier.voltage_monitor),
        current_monitor=parts.monitor(config.amplifier.current_monitor),
        fault=parts.fault_line(),
        modulated=output is not None,
        heartbeats=[*heartbeats, *([watchdog] if watchdog else [])],
        on_event=on_event,
    )
    opening = [*parts.before_rig, rig.connect, *parts.after_rig]
    return Devices(rig, force_sensor, tracker, stage, output, watchdog, opening, parts.closing)


def calibration_ids(config: RigConfig) -> dict[str, str]:
    """Which calibration the figures of each part of a rig come from, for whoever reads its data later.

    Raises DeviceError for a calibration file that cannot be read.
    """
    ids = {
        name: f"{section.measured_by}, {section.measured_at}"
        for name, section in {"limits": config.limits, "amplifier": config.amplifier}.items()
        if section.verified
    }
    match config.force_sensor:
        case rig_config.NiForceSensorConfig(calibration_file=file):
            sensor = AtiCalibration.from_file(Path(file))
            content = hashlib.sha256(Path(file).read_bytes()).hexdigest()
            ids["force_sensor"] = f"{sensor.serial}, calibrated {sensor.calibrated_on}, SHA-256 {content}"
        case rig_config.NetFtForceSensorConfig() as box:
            ids["force_sensor"] = f"{box.counts_per_n:g} counts per N, {box.counts_per_n_m:g} per N m"
    if isinstance(screen := config.finger_tracker, rig_config.EvdevFingerConfig):
        ids["touch_screen"] = f"{screen.measured_at}{', placeholder' if screen.placeholder else ''}"
    return ids


def generator_transport(config: RigConfig) -> Transport:
    """How the generator is reached; not open. A serial line gets a marker, so that no late answer is believed."""
    generator = config.waveform_generator
    return make_transport(
        generator.resource, visa_backend=generator.visa_backend, baud_rate=generator.baud_rate, marker=scpi_marker
    )


class _Parts:
    """Builds one device after the other, and collects how to open and close them, the last opened closed first."""

    def __init__(self, config: RigConfig) -> None:
        self._config = config
        self.before_rig: list[Callable[[], object]] = []
        self.after_rig: list[Callable[[], object]] = []
        self.closing: list[Callable[[], object]] = []
        self._inputs = self._analog_inputs()

    def force_sensor(self) -> ForceSensor:
        match self._config.force_sensor:
            case rig_config.NiForceSensorConfig() as ni if self._inputs is not None:
                gauges = GaugeForceSensor(
                    self._inputs.columns(ni.gauges),
                    AtiCalibration.from_file(Path(ni.calibration_file)),
                    ForceAxes(ni.normal_axis, ni.lateral_axis),
                    samples_per_reading=ni.samples_per_reading,
                    samples_per_bias=ni.samples_per_bias,
                )
                self.after_rig.append(gauges.take_bias)
                return gauges
            case rig_config.NetFtForceSensorConfig() as box:
                net_ft = NetFt(net_ft_settings(box))
                self.after_rig += [net_ft.open, net_ft.take_bias]
                self.closing.insert(0, net_ft.close)
                return net_ft
        raise BadInputError(
            "no_force_sensor", f"rig {self._config.name} names no force sensor", "add a section [force_sensor]"
        )

    def monitor(self, channel: str | None) -> AnalogInput | None:
        """By its peak: the mean of an alternating voltage says nothing."""
        card = self._config.analog_inputs
        return None if channel is None or self._inputs is None or card is None else peak_of(card, self._inputs, channel)

    def fault_line(self) -> DigitalInput | None:
        name = self._config.amplifier.fault_line
        if name is None:
            return None
        line = NiDigitalInput(name)
        self.before_rig.append(line.open)
        self.closing.insert(0, line.close)
        return line

    def interlock(self) -> tuple[DigitalOutput | None, list[Heartbeat]]:
        """The enable line, if any, and what has to be beaten for it."""
        match self._config.interlock:
            case rig_config.InterlockBox(resource=resource, reply_timeout_s=timeout_s):
                box = HeartbeatInterlock(make_transport(resource), reply_timeout_s=timeout_s)
                self.before_rig.append(box.connect)
                self.closing.insert(0, box.close)
                return box, [box]
            case rig_config.ModemLineInterlock(port=port, line=name, looped_back=looped_back):
                modem_line = ModemLine(port, name, looped_back=looped_back)
                self.before_rig.append(modem_line.connect)
                self.closing.insert(0, modem_line.close)
                return modem_line, []
            case rig_config.NiInterlock(line=name):
                line = NiDigitalOutput(name)
                self.before_rig.append(line.open)
                self.closing.insert(0, line.close)
                return line, []
        return None, []

    def watchdog(self) -> Watchdog | None:
        given = self._config.watchdog
        if given is None or given.generator == NO_WATCHDOG:
            return None
        watchdog = Watchdog(WatchdogSettings(**given.model_dump()))
        self.before_rig.append(watchdog.start)
        self.closing.insert(0, watchdog.close)
        return watchdog

    def stage(self) -> Lts150 | None:
        given = self._config.stage
        if given is None:
            return None
        transport = make_transport(given.resource)
        stage = Lts150(transport, stage_settings(given), set_rts=_rts_of(transport))
        self.after_rig.append(stage.connect)
        self.closing.insert(0, stage.close)
        return stage

    def tracker(self, stage: Lts150 | None) -> FingerTracker | None:
        match self._config.finger_tracker:
            case rig_config.StageFingerConfig(origin_m=(x_m, y_m), direction=(dx, dy)) if stage is not None:
                finger = StageFinger(
                    stage.read_status, origin_m=(x_m, y_m), direction=(dx, dy), interval_s=STAGE_INTERVAL_S
                )
                self.after_rig.append(finger.start)
                self.closing.insert(0, finger.close)
                return finger
            case rig_config.EvdevFingerConfig() as screen:
                touch_screen = open_touch_screen(screen.device, touch_calibration(screen))
                self.closing.insert(0, touch_screen.close)
                return touch_screen
            case rig_config.RecordedFingerConfig(file=file):
                return _recorded(Path(file))
        return None

    def analog_output(self) -> AnalogOutput | None:
        given = self._config.analog_output
        output: AnalogOutput
        match given:
            case rig_config.NiAnalogOutputConfig():
                output = NiAnalogOutput(given.channel, output_settings(given))
            case rig_config.SoundAnalogOutputConfig():
                output = SoundCardOutput(
                    given.device,
                    output_settings(given),
                    sample_rate_hz=given.sample_rate_hz,
                    full_scale_v=given.full_scale_v,
                    dc_coupled=given.dc_coupled,
                    channel=given.channel,
                    latency_s=given.latency_s,
                )
            case _:
                return None
        self.before_rig.append(output.open)  # at its zero level before the carrier can come
        self.closing.append(output.close)
        return output

    def _analog_inputs(self) -> NiAnalogInputs | None:
        card, sensor, amplifier = self._config.analog_inputs, self._config.force_sensor, self._config.amplifier
        if card is None:
            return None
        gauges = sensor.gauges if isinstance(sensor, rig_config.NiForceSensorConfig) else []
        monitors = [channel for channel in (amplifier.voltage_monitor, amplifier.current_monitor) if channel]
        inputs = analog_inputs(card, [*gauges, *monitors])
        self.before_rig.append(inputs.open)
        self.closing.append(inputs.close)
        return inputs


def analog_inputs(card: rig_config.AnalogInputsConfig, channels: Sequence[str]) -> NiAnalogInputs:
    """Some channels of the card as the rig's file describes it; not open."""
    return NiAnalogInputs(
        channels,
        sample_rate_hz=card.sample_rate_hz,
        range_v=card.range_v,
        terminal=card.terminal,
        buffer_s=card.buffer_s,
        timeout_s=card.timeout_s,
    )


def peak_of(card: rig_config.AnalogInputsConfig, inputs: NiAnalogInputs, channel: str) -> NiAnalogInput:
    """A monitor of an alternating voltage, read over the card's window."""
    return NiAnalogInput(inputs, channel, samples=max(1, ceil(card.monitor_window_s * card.sample_rate_hz)), peak=True)


def net_ft_settings(box: rig_config.NetFtForceSensorConfig) -> NetFtSettings:
    """The box's share of a rig's file."""
    return NetFtSettings(
        box.host,
        NetFtScale(box.counts_per_n, box.counts_per_n_m),
        ForceAxes(box.normal_axis, box.lateral_axis),
        port=box.port,
        timeout_s=box.timeout_s,
        ignored_status=box.ignored_status,
        f_t_sequence_advances=box.f_t_sequence_advances,
        bias_tolerance_n=box.bias_tolerance_n,
    )


def stage_settings(given: rig_config.StageConfig) -> StageSettings:
    """The stage's share of a rig's file."""
    low_m, high_m = given.travel_m
    return StageSettings(low_m, high_m, **given.model_dump(exclude={"resource", "travel_m"}))


def output_settings(given: rig_config.SomeAnalogOutput) -> AnalogOutputSettings:
    """The analog output's share of a rig's file."""
    return AnalogOutputSettings(
        given.low_v,
        given.high_v,
        given.zero_level_v,
        given.sample_rate_limit_hz,
        given.buffer_s,
        given.lease_s,
        given.timeout_s,
    )


def touch_calibration(screen: rig_config.EvdevFingerConfig) -> TouchCalibration:
    """The touch screen's share of a rig's file; BadInputError for a matrix that is no map of a plane."""
    (a, b, c), (d, e, f) = screen.matrix_m
    try:
        return TouchCalibration(((a, b, c), (d, e, f)), screen.measured_at, screen.placeholder)
    except ValueError as error:
        said, hint = f"finger_tracker.matrix_m: {error}", "Measure it with haptic calibrate-touch"
        raise BadInputError("bad_config", said, hint) from error


def _rts_of(transport: Transport) -> Callable[[bool], bool] | None:
    return transport.set_rts if isinstance(transport, SerialTransport) else None


def _recorded(path: Path) -> RecordedFinger:
    slide = read_slide(path)
    return RecordedFinger(
        slide.time_s, slide.position_m, 0.0 * slide.position_m, slide.normal_force_n > 0.0, clock=time.monotonic
    )
