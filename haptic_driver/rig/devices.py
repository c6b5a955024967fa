"""From a rig's file to its devices: the drivers of everything it names, wired to one another,
opened and closed.

Gauges and monitors share the one task that a card has for its inputs. Nothing here knows what is at
the other end of a resource; a simulated instrument behind the same name is driven the same way.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence, Set
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Self

from haptic_driver.errors import BadInputError
from haptic_driver.processes.patience import done_within
from haptic_driver.rig.claims import Claims
from haptic_driver.rig.config import RigConfig
from haptic_driver.rig.evidence import REAL_TIME, Clock, KnownOutput, tried
from haptic_driver.rig.load_loop import LoadSensor, LoadStage, clear_for_bias
from haptic_driver.rig.part import NO_WATCHDOG, NONE, DeviceSection, NoPart, Part, Wiring
from haptic_driver.rig.parts.generators import CarrierConfig
from haptic_driver.rig.parts.load_stages import LoadStageSection
from haptic_driver.rig.rig import Rig
from haptic_driver.rig.roles import AFTER, APART, FIRST, RIG, ROLES, KindRole, Opens
from haptic_driver.rig.states import RigEvent
from hw.analog.cards import make_card
from hw.analog.lines import Heartbeat
from hw.analog.output import AnalogOutput, AnalogOutputSettings
from hw.camera.contract import Camera
from hw.errors import DeviceTimeout
from hw.finger.tracker import FingerTracker
from hw.force.sensor import ForceSensor
from hw.generator.analog_carrier.driver import CarrierSettings
from hw.generator.contract import Generator
from hw.generator.settings import GeneratorSettings, ModulationInput, RangePolicy
from hw.health import LINE, MONITOR, UNASKED, Health, WithHealth, with_health
from hw.monitor.contract import ElectrodeMonitor
from hw.safety.watchdog import Watchdog, WatchdogSettings
from hw.stage.lts150 import Lts150
from hw.transport.contract import Transport
from hw.transport.marker import scpi_marker
from hw.transport.resource import make_transport

CLOSE_S = 10.0  # for one device, with the output off
LOAD_ROLES = {"analog_inputs", "force_sensor", "load_stage"}
LINES = {"voltage_monitor": MONITOR, "current_monitor": MONITOR, "fault": LINE}
UNNAMED = ("", "0", "none")  # serial numbers that name no instrument
ATTEMPTS = 4  # at opening: nothing is on yet, and a busy machine may let nobody answer in time


@dataclass(frozen=True, kw_only=True)
class LoadDevices:
    """Force sensor and load stage, closed; use `open` and `close`, or a `with` block.

    Opening takes the sensor's bias: leave it unloaded. What was opened is closed again when
    something after it fails. `heard`: whose health is kept.
    """

    force_sensor: LoadSensor
    load_stage: LoadStage | None
    watchdog: Watchdog | None = None
    opening: Sequence[Callable[[], object]]
    closing: Sequence[Callable[[], object]]
    heard: Sequence[WithHealth] = ()

    @property
    def health(self) -> list[Health]:
        """A record an instrument that is asked."""
        return [one.health for one in self.heard]

    def disown(self, name: str, said: str) -> None:
        """The newest reading of an instrument cannot be true."""
        for one in self.heard:
            if one.health.name == name:
                one.keeper.disown(said)

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

    def close(self) -> object:
        """Stop the stage and hang up; a device that hangs keeps nobody from the next. Never
        raises.
        """
        for step in self.closing:
            done_within(CLOSE_S, partial(tried, step, None))
        return None

    def __enter__(self) -> Self:
        self.open()
        return self

    def __exit__(self, *reason: object) -> None:
        self.close()


@dataclass(frozen=True, kw_only=True)
class Devices(LoadDevices):
    """Everything a rig has.

    Devices open in the order of `ROLES`, the watchdog first, so that each switch-off is in place
    ahead of what it switches off. Closing switches off first.
    """

    rig: Rig
    tracker: FingerTracker | None = None
    stage: Lts150 | None = None
    analog_output: AnalogOutput | None = None
    electrode_monitors: Sequence[ElectrodeMonitor] = ()
    camera: Camera | None = None

    def close(self) -> KnownOutput:
        """Switch off, close everything, and return what was known about the output when the
        generator was hung up: nobody can look after that. Never raises.
        """
        output = self.rig.close()
        super().close()
        return output


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
    before: LoadSensor | None = None,
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
    if config.waveform_generator.is_simulated:
        raise BadInputError(
            "simulated", f"rig {config.name} is simulated", "use haptic_driver.simulation.rig"
        )
    if config.force_sensor is None:
        raise BadInputError(
            "no_force_sensor",
            f"rig {config.name} names no force sensor",
            "add a section [force_sensor]",
        )
    opened = {"analog_output": envelope, "load_stage": load_stage}
    roles = {key for key in ROLES if opened.get(key, True)}
    parts = Assembly(config, roles, config.addresses, before)
    port = generator_port(config)
    rig = build_rig(
        config,
        port,
        parts.one("force_sensor"),
        parts.wiring,
        modulated=not isinstance(config.analog_output, NoPart),
        heartbeats=parts.heartbeats,
        on_event=on_event,
    )
    parts.asking.append(partial(_claim_itself, parts.claims, rig, port))
    return Devices(
        rig=rig,
        tracker=parts.one("finger_tracker"),
        stage=parts.one("stage"),
        analog_output=parts.one("analog_output"),
        electrode_monitors=parts.made["electrode_monitors"],
        camera=parts.one("camera"),
        **parts.holding(rig.connect) | {"heard": [rig.generator, *parts.heard]},
    )


def _claim_itself(claims: Claims, rig: Rig, port: Transport | AnalogOutput) -> None:
    """Claim the generator as it names itself, before anything could switch it off: it may be
    another program's, by another address.
    """
    if not isinstance(port, Transport):
        return  # a card's output has no name but its address
    try:
        found = rig.generator.identify()
        if found.serial_number not in UNNAMED:
            claims.add(f"{found.identity}, serial number {found.serial_number}")
    except BaseException:
        port.close()
        raise


def connect_load(config: RigConfig) -> LoadDevices:
    """What holds a load on the rig; BadInputError for one without a load stage."""
    if config.load_stage.kind == "none":
        raise BadInputError(
            "no_load_stage",
            f"rig {config.name} has no load stage: the load is the finger's own",
            "Add a section [load_stage] to its file",
        )
    addresses = [name for key in LOAD_ROLES for name in config.addresses_of(key)]
    return LoadDevices(**Assembly(config, LOAD_ROLES, addresses).holding())


def build_rig(
    config: RigConfig,
    port: Transport | AnalogOutput,
    force_sensor: ForceSensor,
    lines: Wiring,
    *,
    modulated: bool = False,
    heartbeats: Sequence[Heartbeat] = (),
    on_event: Callable[[RigEvent], None] = lambda event: None,
    clock: Clock = REAL_TIME,
) -> Rig:
    """The devices of `config`, its generator behind `port`; nothing is opened yet. The amplifier is
    that of `lines`, or is made on them.
    """
    key = "waveform_generator"
    generator = with_health(make_generator(config, port), key, ROLES[key].asking, clock.now_s)
    made = config.amplifier.make(lines) if lines.amplifier is None else Part(lines.amplifier)
    if made is None:
        raise BadInputError(
            "no_amplifier", f"rig {config.name} names no amplifier", "correct amplifier.kind"
        )
    return Rig(
        config,
        generator,
        made.device,
        force_sensor,
        modulated=modulated,
        heartbeats=heartbeats,
        on_event=on_event,
        clock=clock,
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


class Assembly:
    """Makes the devices of some roles one after the other, each wired to those before it, and says
    how they are opened and closed.

    The watchdog is over the generator, the load stage or both, as far as they are among the roles.
    `addresses` are claimed. `before`: the force sensor whose bias is kept.
    """

    def __init__(
        self,
        config: RigConfig,
        roles: Set[str],
        addresses: Sequence[str],
        before: LoadSensor | None = None,
    ) -> None:
        channels = [channel for _, section in config.devices for channel in section.channels]
        self.wiring = Wiring(channels=channels)
        self.made: dict[str, list[Any]] = {}
        self.heard: list[WithHealth] = []
        self.heartbeats: list[Heartbeat] = []
        self.asking: list[Callable[[], object]] = []  # before anything can switch off
        self._steps: dict[Opens, list[Callable[[], object]]] = {FIRST: [], RIG: [], AFTER: []}
        self._zeroing: list[Callable[[], object]] = []
        self._load_stage = config.load_stage
        self.claims = Claims(addresses)
        self.closing: list[Callable[[], object]] = [self.claims.release]
        self.watchdog = _watchdog(config, roles)
        if self.watchdog is not None:
            self._steps[FIRST].append(self.watchdog.start)
            self.closing.insert(0, self.watchdog.close)
        for key, role in ROLES.items():
            if key in roles and role.opens is not APART:
                self._make(key, config, before)
        if self.watchdog is not None and self.watchdog.settings.generator:
            self.heartbeats.append(self.watchdog)

    def one(self, key: str) -> Any:
        """The device of a role; None where there is none."""
        return next(iter(self.made.get(key, ())), None)

    def opening(self, *rig: Callable[[], object]) -> list[Callable[[], object]]:
        """What opens them, in order; `rig` opens generator and amplifier. No force sensor takes its
        bias before the load stage stands clear.
        """
        steps = self._steps
        first, last = [self.claims.take, *self.asking], [*steps[AFTER], *self._zeroing]
        return [*first, *steps[FIRST], *steps[RIG], *rig, *last]

    def holding(self, *rig: Callable[[], object]) -> dict[str, Any]:
        """What `LoadDevices` have; `rig` as in `opening`."""
        return {
            "force_sensor": self.one("force_sensor"),
            "load_stage": self.one("load_stage"),
            "watchdog": self.watchdog,
            "heard": self.heard,
            "opening": self.opening(*rig),
            "closing": self.closing,
        }

    def _make(self, key: str, config: RigConfig, before: LoadSensor | None) -> None:
        self.made[key], role = [], ROLES[key]
        for section in config.sections_of(key):
            self.wiring = self._lines_heard(section.wire(self.wiring))
            part = section.make(self.wiring)
            if part is None:
                continue
            self._steps[role.opens] += part.opening
            device = self._heard(key, section, part.device)
            if before is not None and part.zeroing:
                keep = partial(part.device.keep_bias, before)
                self._zeroing.append(partial(device.keeper.keep_zero, keep, before.health))
            elif part.zeroing:
                zeroing = [partial(device.keeper.take_zero, step) for step in part.zeroing]
                self._zeroing += [self._clear, *zeroing]
            self.closing[:0] = part.closing
            self.heartbeats += part.heartbeats
            self.made[key].append(device)
            if role.wired:
                self.wiring = replace(self.wiring, **{role.wired: device})

    def _heard(self, key: str, section: DeviceSection, device: Any) -> Any:
        """The device, whose health is kept from here on; nothing that says so has none to show."""
        role = ROLES[key]
        if role.asking == UNASKED:
            return device
        number = len(self.made[key])
        many = isinstance(role, KindRole) and role.many
        heard = with_health(device, f"{key}.{number}" if many else key, role.asking)
        if getattr(section, "kind", "") != NONE:
            self.heard.append(heard)
        return heard

    def _lines_heard(self, wiring: Wiring) -> Wiring:
        for name, asking in LINES.items():
            line = getattr(wiring, name)
            if line is not None and line is not getattr(self.wiring, name):
                line = with_health(line, name, asking)
                self.heard.append(line)
                wiring = replace(wiring, **{name: line})
        return wiring

    def _clear(self) -> None:
        section, stage = self._load_stage, self.one("load_stage")
        if stage is not None and isinstance(section, LoadStageSection):
            retracts = section.when_wrong == "retract"
            clear_for_bias(stage, section.mounting(), retract=retracts)


def _watchdog(config: RigConfig, roles: Set[str]) -> Watchdog | None:
    section, given, stage = config.load_stage, config.watchdog, None
    if "load_stage" in roles and isinstance(section, LoadStageSection):
        stage = section.guarded()
    if "waveform_generator" in roles and given is not None and given.generator != NO_WATCHDOG:
        own = config.waveform_generator
        return Watchdog(
            WatchdogSettings(
                **given.model_dump(),
                model=own.model,
                visa_backend=own.visa_backend,
                load_stage=stage,
            )
        )
    return None if stage is None else Watchdog(WatchdogSettings(None, load_stage=stage))
