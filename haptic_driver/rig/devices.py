"""From a rig's file to its devices: the drivers of everything it names, wired to one another,
opened and closed.

Gauges and monitors share the one task that a card has for its inputs. Nothing here knows what is at
the other end of a resource; a simulated instrument behind the same name is driven the same way.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, Self

from haptic_driver.errors import BadInputError
from haptic_driver.processes.patience import done_within
from haptic_driver.rig.claims import Claims
from haptic_driver.rig.config import AnalogInputsConfig, RigConfig, addresses_of
from haptic_driver.rig.evidence import OffEvidence, tried
from haptic_driver.rig.load_loop import LoadStage
from haptic_driver.rig.part import (
    AMPLIFIERS,
    ANALOG_OUTPUTS,
    CAMERAS,
    ELECTRODE_MONITORS,
    FINGER_TRACKERS,
    FORCE_SENSORS,
    LOAD_STAGES,
    NO_WATCHDOG,
    PartSection,
    Wiring,
    make_part,
)
from haptic_driver.rig.parts.analog_outputs import NoAnalogOutput
from haptic_driver.rig.parts.generators import CarrierConfig
from haptic_driver.rig.parts.interlocks import InterlockBox, ModemLineInterlock, NiInterlock
from haptic_driver.rig.parts.load_stages import LoadStageSection
from haptic_driver.rig.rig import Rig
from haptic_driver.rig.states import RigEvent
from hw.analog.cards import make_card
from hw.analog.lines import AnalogInput, DigitalInput, DigitalOutput, Heartbeat
from hw.analog.ni_daq import (
    NiAnalogInput,
    NiAnalogInputs,
    NiCards,
    NiDigitalInput,
    NiDigitalOutput,
    card_of,
)
from hw.analog.output import AnalogOutput, AnalogOutputSettings
from hw.camera.contract import Camera
from hw.errors import DeviceTimeout
from hw.finger.tracker import FingerTracker
from hw.force.sensor import ForceSensor
from hw.generator.analog_carrier.driver import CarrierSettings
from hw.generator.contract import Generator
from hw.generator.settings import GeneratorSettings, ModulationInput, RangePolicy
from hw.monitor.contract import ElectrodeMonitor
from hw.safety.interlock import HeartbeatInterlock, ModemLine
from hw.safety.watchdog import Watchdog, WatchdogSettings
from hw.stage.lts150 import Lts150
from hw.transport.contract import Transport
from hw.transport.marker import scpi_marker
from hw.transport.resource import make_transport
from hw.transport.serial import SerialTransport

CLOSE_S = 10.0  # for one device, with the output off
ATTEMPTS = 4  # at opening: nothing is on yet, and a busy machine may let nobody answer in time


@dataclass(frozen=True)
class Devices:
    """Everything a rig has, closed; use `open` and `close`, or a `with` block.

    Devices open in an order that puts each switch-off in place ahead of what it switches off. The
    order is interlock, watchdog, envelope (at its zero level), generator (off and reset), sensors,
    stage. Sensors take their bias: leave the force sensor unloaded. Closing switches off first.
    What was opened is closed again when something after it fails.
    """

    rig: Rig
    force_sensor: ForceSensor
    tracker: FingerTracker | None
    stage: Lts150 | None
    analog_output: AnalogOutput | None
    watchdog: Watchdog | None
    opening: Sequence[Callable[[], object]]
    closing: Sequence[Callable[[], object]]
    electrode_monitors: Sequence[ElectrodeMonitor] = ()
    camera: Camera | None = None
    load_stage: LoadStage | None = None

    def open(self) -> None:
        """Open everything; whoever answers late is asked again. Raises HapticError and
        DeviceError.
        """
        try:
            for step in self.opening:
                _patiently(step)
        except BaseException:
            self.close()
            raise

    def close(self) -> OffEvidence:
        """Switch off, close everything, and return what is known about the output. Never raises.

        A device that hangs keeps nobody from the next.
        """
        evidence = self.rig.close()
        for step in self.closing:
            done_within(CLOSE_S, partial(tried, step, None))
        return evidence

    def __enter__(self) -> Self:
        self.open()
        return self

    def __exit__(self, *reason: object) -> None:
        self.close()


def _patiently(step: Callable[[], object]) -> None:
    for _ in range(ATTEMPTS - 1):
        try:
            step()
            return
        except DeviceTimeout:
            continue
    step()


def connect_devices(
    config: RigConfig,
    *,
    on_event: Callable[[RigEvent], None] = lambda event: None,
    before: ForceSensor | None = None,
    envelope: bool = True,
    load_stage: bool = False,
) -> Devices:
    """The drivers of the devices that `config` names; nothing is opened before the result is
    entered.

    With an analog output the generator's amplitude follows it. `before`: the force sensor of an
    earlier connection, whose bias is kept, since a finger may press now. Without `envelope` the
    analog output is somebody else's to open, before these; the load stage stays closed unless asked
    for. Raises BadInputError for a rig without hardware.
    """
    if config.simulated:
        raise BadInputError(
            "simulated", f"rig {config.name} is simulated", "use haptic_driver.simulation.rig"
        )
    parts = _Parts(config)
    force_sensor = parts.force_sensor(before)
    stage = parts.stage()
    tracker = parts.reader(FINGER_TRACKERS, config.finger_tracker, Wiring(parts.inputs, stage))
    watchdog = parts.watchdog(load_stage)
    enable, heartbeats = parts.interlock()
    output = parts.analog_output() if envelope else None
    monitors = parts.electrode_monitors()
    camera = parts.reader(CAMERAS, config.camera, Wiring())
    pressing = parts.load_stage() if load_stage else None
    amplifier = config.amplifier
    lines = Wiring(
        enable=enable,
        voltage_monitor=parts.monitor(amplifier.voltage_monitor),
        current_monitor=parts.monitor(amplifier.current_monitor),
        fault=parts.fault_line(),
    )
    beaten = [*heartbeats, *([watchdog] if watchdog and watchdog.settings.generator else [])]
    rig = build_rig(
        config,
        generator_port(config),
        force_sensor,
        lines,
        modulated=not isinstance(config.analog_output, NoAnalogOutput),
        heartbeats=beaten,
        on_event=on_event,
    )
    claims = Claims(config.addresses)
    opening = [claims.take, *parts.before_rig, rig.connect, *parts.after_rig]
    closing = [*parts.closing, claims.release]
    return Devices(
        rig,
        force_sensor,
        tracker,
        stage,
        output,
        watchdog,
        opening,
        closing,
        monitors,
        camera,
        pressing,
    )


@dataclass(frozen=True)
class LoadDevices:
    """Force sensor and load stage alone, open inside a `with` block; the generator is left alone.

    Opening takes the sensor's bias: leave it unloaded. Raises HapticError and DeviceError.
    """

    force_sensor: ForceSensor
    stage: LoadStage
    opening: Sequence[Callable[[], object]]
    closing: Sequence[Callable[[], object]]
    watchdog: Watchdog | None = None

    def __enter__(self) -> Self:
        try:
            for step in self.opening:
                _patiently(step)
        except BaseException:
            self.__exit__()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        """Stop the stage and hang up."""
        for step in self.closing:
            done_within(CLOSE_S, partial(tried, step, None))


def connect_load(config: RigConfig) -> LoadDevices:
    """What holds a load on the rig; BadInputError for one without a load stage."""
    if config.load_stage.kind == "none":
        raise BadInputError(
            "no_load_stage",
            f"rig {config.name} has no load stage: the load is the finger's own",
            "Add a section [load_stage] to its file",
        )
    parts = _Parts(config)
    force_sensor = parts.force_sensor(None)
    watchdog = parts.watchdog(True, generator=False)
    stage = parts.load_stage()
    assert stage is not None  # a kind that is not "none" makes one
    claims = Claims(addresses_of([config.force_sensor, config.load_stage]))
    return LoadDevices(
        force_sensor,
        stage,
        [claims.take, *parts.before_rig, *parts.after_rig],
        [*parts.closing, claims.release],
        watchdog,
    )


def build_rig(
    config: RigConfig,
    port: Transport | AnalogOutput,
    force_sensor: ForceSensor,
    lines: Wiring,
    *,
    modulated: bool = False,
    heartbeats: Sequence[Heartbeat] = (),
    on_event: Callable[[RigEvent], None] = lambda event: None,
    sleep: Callable[[float], None] = time.sleep,
) -> Rig:
    """The devices of `config`, its generator behind `port` and its amplifier on `lines`; nothing is
    opened yet.
    """
    generator = make_generator(config, port)
    amplifier = make_part(AMPLIFIERS, config.amplifier, lines)
    if amplifier is None:
        raise BadInputError(
            "no_amplifier", f"rig {config.name} names no amplifier", "correct amplifier.kind"
        )
    return Rig(
        config,
        generator,
        amplifier.device,
        force_sensor,
        modulated=modulated,
        heartbeats=heartbeats,
        on_event=on_event,
        sleep=sleep,
    )


def generator_settings(config: RigConfig) -> GeneratorSettings:
    """The generator's share of a rig's file, and the rig's limits as its driver and last gate know
    them.
    """
    generator = config.waveform_generator
    return GeneratorSettings(
        volts_per_volt=config.amplifier.gain_v_per_v,
        voltage_limit_v=config.limits.voltage_v,
        frequency_low_hz=config.limits.frequency_hz[0],
        frequency_high_hz=config.limits.frequency_hz[1],
        reply_timeout_s=generator.reply_timeout_s,
        range_policy=RangePolicy(generator.range_policy),
        modulation_input=modulation_input(config),
    )


def modulation_input(config: RigConfig) -> ModulationInput | None:
    """What Modulation In does, by a rig's file; None where nobody has measured it."""
    given = config.waveform_generator.modulation_input
    return (
        None
        if given is None
        else ModulationInput(given.full_scale_v, given.amplitude_at_full_scale)
    )


def calibration_ids(config: RigConfig) -> dict[str, str]:
    """Which calibration the figures of each part of a rig come from, for whoever reads its data
    later.

    Raises DeviceError for a calibration file that cannot be read.
    """
    ids = {
        name: f"{section.measured_by}, {section.measured_at}"
        for name, section in {"limits": config.limits, "amplifier": config.amplifier}.items()
        if section.verified
    }
    parts = {"force_sensor": config.force_sensor, "touch_screen": config.finger_tracker}
    return ids | {
        name: said
        for name, part in parts.items()
        if part is not None and (said := part.calibration())
    }


def make_generator(config: RigConfig, port: Transport | AnalogOutput) -> Generator:
    """The generator's driver, behind its transport, or on the analog output that stands in for
    it.
    """
    kind, carrier = config.generator_kind(), config.waveform_generator.carrier
    if carrier is None:
        return kind.make(port, generator_settings(config))
    samples = CarrierSettings(carrier.sample_rate_hz, carrier.lead_s)
    return kind.make(port, generator_settings(config), samples)


def carrier_output(carrier: CarrierConfig) -> AnalogOutputSettings:
    """What the output that makes a carrier may do."""
    return AnalogOutputSettings(
        -carrier.peak_v,
        carrier.peak_v,
        0.0,
        carrier.sample_rate_hz,
        buffer_s=2.0 * carrier.lead_s,
        timeout_s=carrier.timeout_s,
    )


def generator_port(config: RigConfig) -> Transport | AnalogOutput:
    """How the generator is reached; not open. A serial line gets a marker, so that no late answer
    is believed.
    """
    generator = config.waveform_generator
    if generator.carrier is not None:
        return make_card(generator.resource, carrier_output(generator.carrier))
    return make_transport(
        generator.resource,
        visa_backend=generator.visa_backend,
        baud_rate=generator.baud_rate,
        marker=scpi_marker,
    )


class _Parts:
    """Builds one device after the other, and collects how to open and close them, the last opened
    closed first.
    """

    def __init__(self, config: RigConfig) -> None:
        self._config = config
        self.before_rig: list[Callable[[], object]] = []
        self.after_rig: list[Callable[[], object]] = []
        self.closing: list[Callable[[], object]] = []
        self.inputs = self._analog_inputs()

    def force_sensor(self, before: ForceSensor | None) -> ForceSensor:
        sensor = self._config.force_sensor
        part = None if sensor is None else make_part(FORCE_SENSORS, sensor, Wiring(self.inputs))
        if part is None:
            raise BadInputError(
                "no_force_sensor",
                f"rig {self._config.name} names no force sensor",
                "add a section [force_sensor]",
            )
        zeroing = part.zeroing
        if before is not None and zeroing:
            zeroing = [partial(part.device.keep_bias, before)]
        self.after_rig += [*part.opening, *zeroing]
        self.closing[:0] = part.closing
        device: ForceSensor = part.device
        return device

    def monitor(self, channel: str | None) -> AnalogInput | None:
        """By its peak: the mean of an alternating voltage says nothing."""
        card = self._config.analog_inputs
        return (
            None
            if channel is None or self.inputs is None or card is None
            else peak_of(card, self.inputs, channel)
        )

    def fault_line(self) -> DigitalInput | None:
        name = self._config.amplifier.fault_line
        if name is None:
            return None
        line = NiDigitalInput(name)
        self._first(line.open, line.close)
        return line

    def interlock(self) -> tuple[DigitalOutput | None, list[Heartbeat]]:
        """The enable line, if any, and what has to be beaten for it."""
        match self._config.interlock:
            case InterlockBox(resource=resource, reply_timeout_s=timeout_s):
                box = HeartbeatInterlock(make_transport(resource), reply_timeout_s=timeout_s)
                self._first(box.connect, box.close)
                return box, [box]
            case ModemLineInterlock(port=port, line=name, looped_back=looped_back):
                modem_line = ModemLine(port, name, looped_back=looped_back)
                self._first(modem_line.connect, modem_line.close)
                return modem_line, []
            case NiInterlock(line=name):
                line = NiDigitalOutput(name)
                self._first(line.open, line.close)
                return line, []
        return None, []

    def watchdog(self, load_stage: bool, generator: bool = True) -> Watchdog | None:
        """Over the generator, the load stage, both, or None where there is neither to watch."""
        section, given = self._config.load_stage, self._config.watchdog
        stage = None
        if load_stage and isinstance(section, LoadStageSection):
            stage = section.guarded()
        if generator and given is not None and given.generator != NO_WATCHDOG:
            own = self._config.waveform_generator
            settings = WatchdogSettings(
                **given.model_dump(),
                model=own.model,
                visa_backend=own.visa_backend,
                load_stage=stage,
            )
        elif stage is not None:
            settings = WatchdogSettings(None, load_stage=stage)
        else:
            return None
        watchdog = Watchdog(settings)
        self._first(watchdog.start, watchdog.close)
        return watchdog

    def stage(self) -> Lts150 | None:
        given = self._config.stage
        if given is None:
            return None
        transport = make_transport(given.resource, rtscts=True)
        set_rts = transport.set_rts if isinstance(transport, SerialTransport) else None
        stage = Lts150(transport, given.settings(), set_rts=set_rts)
        self.after_rig.append(stage.connect)
        self.closing.insert(0, stage.close)
        return stage

    def _first(self, opening: Callable[[], object], closing: Callable[[], object]) -> None:
        self.before_rig.append(opening)
        self.closing.insert(0, closing)

    def load_stage(self) -> LoadStage | None:
        """Stopped as it is closed, after the output has gone off."""
        part = make_part(LOAD_STAGES, self._config.load_stage, Wiring())
        if part is None:
            return None
        self.after_rig += part.opening
        self.closing[:0] = part.closing
        device: LoadStage = part.device
        return device

    def reader(self, group: str, section: PartSection, wiring: Wiring) -> Any:
        """What only reads is opened last and closed first; None where there is none."""
        part = make_part(group, section, wiring)
        if part is None:
            return None
        self.after_rig += part.opening
        self.closing[:0] = part.closing
        return part.device

    def analog_output(self) -> AnalogOutput | None:
        """At its zero level before the carrier can come, and after it has gone."""
        part = make_part(ANALOG_OUTPUTS, self._config.analog_output, Wiring(self.inputs))
        if part is None:
            return None
        self.before_rig += part.opening
        self.closing += part.closing
        device: AnalogOutput = part.device
        return device

    def electrode_monitors(self) -> list[ElectrodeMonitor]:
        amplifier, sections = self._config.amplifier, self._config.electrode_monitors
        wiring = Wiring(
            self.inputs,
            monitor_lines=amplifier.monitor_lines(),
            monitor_channels=amplifier.channels,
        )
        made = [self.reader(ELECTRODE_MONITORS, section, wiring) for section in sections]
        return [monitor for monitor in made if monitor is not None]

    def _analog_inputs(self) -> NiCards | None:
        config, card = self._config, self._config.analog_inputs
        if card is None:
            return None
        inputs = analog_inputs(
            card, [channel for part in config.parts for channel in part.channels]
        )
        self.before_rig.append(inputs.open)
        self.closing.append(inputs.close)
        return inputs


def analog_inputs(card: AnalogInputsConfig, channels: Sequence[str]) -> NiCards:
    """Some channels, of one card or several, as the rig's file describes them; not open."""
    how = card.model_dump(exclude={"monitor_window_s", "terminal", "terminals"})
    cards: dict[str, list[str]] = {}
    for channel in channels:
        cards.setdefault(card_of(channel), []).append(channel)
    return NiCards(
        [
            NiAnalogInputs(on_card, terminal={one: card.terminal_of(one) for one in on_card}, **how)
            for on_card in cards.values()
        ]
    )


def peak_of(card: AnalogInputsConfig, inputs: NiCards, channel: str) -> NiAnalogInput:
    """A monitor of an alternating voltage, read over the card's window."""
    return NiAnalogInput(inputs, channel, window_s=card.monitor_window_s, peak=True)
