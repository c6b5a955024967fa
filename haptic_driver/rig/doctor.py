"""Looks at a rig without energising it, and says what it could not verify.

Only questions are asked: nothing is set, reset or switched, no error queue is emptied, no line is
opened whose opening could raise it, no bias is taken, nothing moves. What only a voltage could show
stays "not verified".
"""

from __future__ import annotations

import datetime
import enum
import os
import re
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, NamedTuple, Protocol

from haptic_driver.config import Section
from haptic_driver.errors import BadInputError
from haptic_driver.processes.real_time import PRIORITY
from haptic_driver.rig import config as rig_config
from haptic_driver.rig.config import RigConfig
from haptic_driver.rig.devices import (
    analog_inputs,
    generator_port,
    make_generator,
    peak_of,
    stage_settings,
)
from haptic_driver.rig.evidence import MONITOR_QUIET_V
from haptic_driver.rig.part import CAMERAS, NO_WATCHDOG, Vouched, Wiring, make_part
from haptic_driver.rig.parts.analog_outputs import NoAnalogOutput
from haptic_driver.rig.parts.electrode_monitors import InstrumentMonitor
from haptic_driver.rig.parts.finger_trackers import (
    EvdevFingerConfig,
    NoFingerTracker,
    RecordedFingerConfig,
    StageFingerConfig,
)
from haptic_driver.rig.parts.force_sensors import (
    NetFtForceSensorConfig,
    NiForceSensorConfig,
    NoForceSensorConfig,
)
from hw.analog.ni_daq import NiDigitalInput
from hw.errors import BadReply, DeviceError
from hw.finger.touch_screen import open_touch_reports
from hw.force.ati_calibration import AtiCalibration
from hw.force.net_ft import NetFt
from hw.generator.contract import GeneratorKind, GeneratorReport
from hw.safety.interlock import IDENTITY
from hw.setting import Setting
from hw.stage import apt
from hw.stage.lts150 import Lts150
from hw.transport.contract import Transport
from hw.transport.resource import make_transport

AMPLIFIER_FIGURES = ("gain_v_per_v", "voltage_monitor_v_per_v", "current_monitor_v_per_a")
OUTPUT_FIGURES = ("sample_rate_hz", "full_scale_v", "latency_s", "sample_rate_limit_hz")
BOX_FIGURES = ("counts_per_n", "counts_per_n_m")
OLD_AFTER = datetime.timedelta(days=365)
CALIBRATE_TOUCH = "measure it by touching known places: haptic calibrate-touch"


class CheckStatus(enum.Enum):
    """What came of one check."""

    OK = "ok"
    WARNING = "warning"
    FAILED = "failed"
    NOT_VERIFIED = "not verified"


class Check(NamedTuple):
    """One thing looked at: what was found, and what to do about it.

    `held`: what is asked of a device, and what it has got now; a generator gets the rest at
    connecting.
    """

    name: str
    status: CheckStatus
    message: str
    hint: str = ""
    held: tuple[Setting, ...] = ()


Checks = Iterator[Check]


def _ok(name: str, message: str) -> Check:
    return Check(name, CheckStatus.OK, message)


def _warning(name: str, message: str, hint: str = "") -> Check:
    return Check(name, CheckStatus.WARNING, message, hint)


def _failed(name: str, message: str, hint: str = "") -> Check:
    return Check(name, CheckStatus.FAILED, message, hint)


def _unverified(name: str, message: str, hint: str = "") -> Check:
    return Check(name, CheckStatus.NOT_VERIFIED, message, hint)


def examine(config: RigConfig, today: datetime.date) -> list[Check]:
    """All checks of a real rig, in order; never raises DeviceError. Takes a few timeouts per absent
    device.
    """
    return [
        *_figures(config, today),
        *_resources(),
        *_generator(config),
        *_amplifier(config),
        *_electrode_monitors(config),
        *_interlock(config),
        *_force_sensor(config),
        *_stage(config),
        *_finger_tracker(config, today),
        *_camera(config),
        *_analog_output(config),
        *_real_time(),
    ]


# --- the file
# ------------------------------------------------------------------------------------------------


def _figures(config: RigConfig, today: datetime.date) -> Checks:
    for missing in config.unverified:
        yield _failed(
            "configuration",
            f"{missing} unset: the rig refuses to come on",
            "measure, then write it down",
        )
    sections = {
        "limits": config.limits,
        "amplifier": config.amplifier,
        "modulation input": config.waveform_generator.modulation_input,
        "carrier": config.waveform_generator.carrier,
        "analog output": config.analog_output,
    }
    for name, section in sections.items():
        if isinstance(section, Vouched) and section.verified and section.measured_at is not None:
            yield _dated(
                f"{name} figures", f"measured by {section.measured_by}", section.measured_at, today
            )


def _dated(name: str, what: str, on: datetime.date, today: datetime.date) -> Check:
    said = f"{what} on {on.isoformat()}"
    if on > today:
        return _warning(name, f"{said}, which is still to come", "correct the date")
    if today - on > OLD_AFTER:
        return _warning(name, f"{said}, {(today - on).days} days ago", "measure again")
    return _ok(name, said)


# --- the machine
# -------------------------------------------------------------------------------------------------


def _resources() -> Checks:
    """What this machine sees; an empty list is no fault, since instruments on the LAN do not
    show.
    """
    found = [*_serial_ports(), *_usb_instruments()]
    yield _ok("resources", ", ".join(found) or "no serial ports or USB instruments seen")


def _serial_ports() -> Iterator[str]:
    from serial.tools import list_ports  # noqa: PLC0415 - only the doctor lists

    for port in list_ports.comports():
        yield (
            f"{port.device} ({port.description})"
            if port.description not in (None, "n/a")
            else port.device
        )


def _usb_instruments() -> Iterator[str]:
    import usb.core  # noqa: PLC0415 - only the doctor lists

    def is_instrument(device: Any) -> bool:
        with suppress(usb.core.USBError):
            interfaces = [one for configuration in device for one in configuration]
            return any(
                one.bInterfaceClass == 0xFE and one.bInterfaceSubClass == 3 for one in interfaces
            )
        return False

    with suppress(usb.core.NoBackendError, usb.core.USBError):
        for device in usb.core.find(find_all=True, custom_match=is_instrument):
            yield f"USB0::{device.idVendor:#06x}::{device.idProduct:#06x}"


def _real_time() -> Checks:
    """Tried and taken back at once, for this process only."""
    if not hasattr(os, "sched_setscheduler"):
        yield _warning(
            "real-time scheduling",
            "this system has none that is known here",
            "run the daemon on Linux",
        )
        return
    before = os.sched_getscheduler(0), os.sched_getparam(0)
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
    except OSError as error:
        hint = (
            f"allow it: LimitRTPRIO={PRIORITY} in the service, or rtprio in"
            " /etc/security/limits.conf"
        )
        yield _warning(
            "real-time scheduling", f"SCHED_FIFO {PRIORITY} is refused ({error.strerror})", hint
        )
        return
    os.sched_setscheduler(0, *before)
    yield _ok("real-time scheduling", f"SCHED_FIFO {PRIORITY} is granted")


# --- waveform generator
# ------------------------------------------------------------------------------------------


def _generator(config: RigConfig) -> Checks:
    port, kind = generator_port(config), config.generator_kind()
    with _failures("waveform generator", port) as failed:
        found = make_generator(config, port).identify()
        said = f"{found.identity}, serial number {found.serial_number}"
        yield _ok("waveform generator", said)._replace(held=tuple(found.held))
        yield _unverified(
            "firmware", f"{found.firmware}; couplings and clipping are those of manuals"
        )
        yield from _generator_state(found)
        yield from _voltage_limit(config, kind)
        yield from _watchdog(config)  # while the driver's connection is open, as it will be
    yield from failed


def _generator_state(found: GeneratorReport) -> Checks:
    if found.output_on:
        yield _warning(
            "output",
            f"ON, {found.programmed}: somebody uses it",
            "switch it off before working here",
        )
    else:
        yield _ok("output", f"off; programmed: {found.programmed}")
    if found.load_open:
        yield _ok("load setting", "open: programmed volts are volts at the amplifier's input")
    else:
        yield _warning(
            "load setting",
            "not open: at the amplifier's high-impedance input the voltage is up to twice what is"
            " programmed",
            "connecting the driver corrects it; by hand, correct it before the output is"
            " switched on",
        )


def _voltage_limit(config: RigConfig, kind: GeneratorKind) -> Checks:
    reach_v = 0.5 * kind.amplitude_high_vpp * config.amplifier.gain_v_per_v
    limit_v = config.limits.voltage_v
    if reach_v < limit_v:
        said = f"the generator reaches {reach_v:g} V, the limit is {limit_v:g} V"
        yield _warning("voltage limit", said, "check amplifier.gain_v_per_v")
    keeper = (
        "this program, and by the generator once it is connected"
        if kind.limits_itself
        else "this program alone: the generator's driver sets no limit of the instrument's own"
    )
    could_v = min(reach_v, config.amplifier.voltage_limit_v)
    said = f"{limit_v:g} V is kept by {keeper}; with this amplifier it could ask for {could_v:g} V"
    yield _unverified("voltage limit", said, "limit the amplifier in hardware where it can be")


def _watchdog(config: RigConfig) -> Checks:
    given = config.watchdog
    if given is None or given.generator == NO_WATCHDOG:
        hint = (
            "give it a connection of its own, e.g. the generator's LAN socket; or use an"
            " interlock box"
        )
        yield _warning(
            "watchdog", "there is none: if the driver dies, the output stays as it is", hint
        )
        return
    if config.generator_kind().by_samples:
        said = f"{given.generator}: opening it would put out a level; it is not started here"
        yield _unverified("watchdog", said, "kill an armed driver once")
        return
    transport = make_transport(given.generator)
    with _failures("watchdog", transport) as failed:
        transport.open()
        kind = config.generator_kind()
        reply = transport.query(kind.ask_off, given.reply_timeout_s).strip()
        if not kind.off_answers.fullmatch(reply):
            raise BadReply(
                f"{transport.resource} answered {reply[:80]!r}", "check watchdog.generator"
            )
        yield _ok("watchdog", f"{transport.resource} answers beside the driver's connection")
        yield _unverified(
            "watchdog switching off", "it is not started here", "kill an armed driver once"
        )
    yield from failed


# --- amplifier
# ------------------------------------------------------------------------------------------------


def _amplifier(config: RigConfig) -> Checks:
    amplifier = config.amplifier
    yield _unverified(
        "amplifier",
        f"gain {amplifier.gain_v_per_v:g}, {amplifier.voltage_limit_v:g} V,"
        f" {amplifier.current_limit_a:g} A, {amplifier.slew_limit_v_per_s:g} V/s: it has no"
        " dialogue, and nothing is energised here",
        "compare one low voltage with a probe",
    )._replace(held=_untold(amplifier, AMPLIFIER_FIGURES))
    yield from _fault_line(config)
    yield from _monitors(config)


def _fault_line(config: RigConfig) -> Checks:
    name = config.amplifier.fault_line
    if name is None:
        yield _unverified(
            "fault line", "there is none: a tripped amplifier shows on its monitor at best"
        )
        return
    line = NiDigitalInput(name)
    with _failures("fault line", line) as failed:
        if line.read() is config.amplifier.fault_level:
            yield _failed("fault line", "it says fault", "look at the amplifier; check fault_level")
        else:
            yield _ok("fault line", "no fault")
    yield from failed


def _monitors(config: RigConfig) -> Checks:
    amplifier, card, name = config.amplifier, config.analog_inputs, "voltage monitor"
    if amplifier.voltage_monitor is None or card is None:
        said = "there is none: nothing sees the electrode, and off means that the generator says so"
        yield _unverified(name, said, "wire the amplifier's monitor to an analog input")
        return
    inputs = analog_inputs(card, [amplifier.voltage_monitor])
    with _failures(name, inputs) as failed:
        inputs.open()
        monitor = peak_of(card, inputs, amplifier.voltage_monitor)
        electrode_v = monitor.read_v() / amplifier.voltage_monitor_v_per_v
        said = f"peak {electrode_v:.3g} V at the electrode"
        quiet = electrode_v <= MONITOR_QUIET_V
        check = _ok(name, said) if quiet else _failed(name, said, "something drives it")
        yield check._replace(held=tuple(inputs.held()))
        yield _unverified(
            "monitor scale", "needs a voltage", "compare one low voltage with a probe"
        )
    yield from failed


def _electrode_monitors(config: RigConfig) -> Checks:
    """Instruments are asked who they are; what they would read needs a voltage."""
    for section in config.electrode_monitors:
        name = f"electrode monitor, {section.kind}"
        if not isinstance(section, InstrumentMonitor):
            yield _unverified(
                name,
                "needs a voltage",
                "a resistor in the finger's place must read as one throughout",
            )
            continue
        monitor = section.driver(config.amplifier.monitor_lines())
        with _failures(name, monitor.line) as failed:
            identity = monitor.line.identify(section.identity())
            yield _ok(name, identity)._replace(held=tuple(monitor.held()))
        yield from failed


def _camera(config: RigConfig) -> Checks:
    """It is opened, which sets it up; a burst is not taken."""
    part = make_part(CAMERAS, config.camera, Wiring())
    if part is None:
        return
    with _failures("camera", part.device) as failed:
        part.device.open()
        yield _ok("camera", f"{config.camera.kind}, answers and takes its settings")
        yield _unverified(
            "camera scale", "nobody looked", "film a ruler: haptic contact --scale-from"
        )
    yield from failed


def _interlock(config: RigConfig) -> Checks:
    match config.interlock:
        case rig_config.InterlockBox(resource=resource, reply_timeout_s=timeout_s):
            transport = make_transport(resource)
            with _failures("interlock", transport) as failed:
                transport.open()
                identity = _ask(transport, "ID?", 10.0 * timeout_s)
                if identity != IDENTITY:
                    raise BadReply(
                        f"{transport.resource} is {identity!r}, not {IDENTITY!r}", "check the port"
                    )
                status = _ask(transport, "STATUS?", 10.0 * timeout_s)
                if status.startswith("OFF "):
                    yield _ok("interlock", f"{identity}: {status}")
                else:
                    hint = "its contact is closed: somebody uses the rig"
                    yield _warning("interlock", f"{identity}: {status}", hint)
                yield _unverified("interlock contact", "its wiring shows only when it closes")
            yield from failed
        case rig_config.ModemLineInterlock() as modem:
            line = f"{modem.line.upper()} of {modem.port}"
            said = f"{line}: opening the port may raise the line for a moment: it is left"
            yield _unverified("interlock", said, "a heartbeat interlock box is safer")
        case rig_config.NiInterlock(line=line):
            yield _unverified(
                "interlock", f"{line}: taking an output may set it, so it is left alone"
            )
        case _:
            said = (
                "there is none: the amplifier's state stays unknown, and off means that the"
                " generator says so; where the computer stops, or driver and watchdog do, the"
                " output stays on"
            )
            yield _warning(
                "interlock", said, "wire its enable line to an interlock box, where it has one"
            )


# --- sensors and stage
# -------------------------------------------------------------------------------------------


def _force_sensor(config: RigConfig) -> Checks:
    match config.force_sensor:
        case NetFtForceSensorConfig() as box:
            net_ft = NetFt(box.settings())
            with _failures("force sensor", net_ft) as failed:
                net_ft.open()
                reading = net_ft.read()
                said = (
                    f"{net_ft.resource}: {reading.normal_force_n:.3f} N down,"
                    f" {reading.lateral_force_n:.3f} N along"
                )
                check = _failed if reading.saturated else _ok
                told = check("force sensor", f"{said}, status {net_ft.status_raw:#010x}")
                yield told._replace(held=_untold(box, BOX_FIGURES))
                yield _unverified("force scale", "counts and axes", "hang a known weight on it")
            yield from failed
        case NiForceSensorConfig() as ni:
            yield from _gauges(config, ni)
        case NoForceSensorConfig() as none:
            source = (
                "the electrode's current"
                if config.friction_from_current
                else f"no reading: {none.load_n:g} N"
            )
            yield _warning(
                "force sensor",
                f"none; load and friction from {source}",
                "docs/live.md says what that holds",
            )
        case None:
            yield _failed(
                "force sensor", "there is none in the rig's file", "add a section [force_sensor]"
            )
        case other:
            yield _unverified("force sensor", f"{other.kind}: how to ask it is not known here")


def _gauges(config: RigConfig, ni: NiForceSensorConfig) -> Checks:
    card = config.analog_inputs
    assert card is not None  # or the file would have been refused
    inputs = analog_inputs(card, ni.gauges)
    with _failures("force sensor", inputs) as failed:
        calibration = AtiCalibration.from_file(Path(ni.calibration_file))
        said = (
            f"{calibration.serial} ({calibration.part_number}), calibrated:"
            f" {calibration.calibrated_on}"
        )
        yield (_warning if calibration.calibrated_on == "unknown" else _ok)(
            "force calibration", said
        )
        inputs.open()
        gauges_v = inputs.latest_v(ni.samples_per_bias)
        said = "gauges at " + ", ".join(f"{v:.3f}" for v in gauges_v.mean(axis=0)) + " V"
        saturated = calibration.saturated(gauges_v)
        check = (
            _failed("force sensor", said, "unload it") if saturated else _ok("force sensor", said)
        )
        yield check._replace(held=tuple(inputs.held()))
    yield from failed


def _stage(config: RigConfig) -> Checks:
    if config.stage is None:
        return
    transport = make_transport(config.stage.resource)
    settings = stage_settings(config.stage)
    with _failures("stage", transport) as failed:
        transport.open()
        info = _stage_info(transport, settings.reply_timeout_s)
        stage = Lts150(transport, settings)
        status, held = stage.read_status(), tuple(stage.held())
        said = f"{info.model}, serial number {info.serial_number}, firmware {info.firmware}"
        is_one = info.model.startswith(settings.model)
        check = _ok("stage", said) if is_one else _failed("stage", said, f"not a {settings.model}")
        yield check._replace(held=held)
        where = f"at {1e3 * status.position_m:.2f} mm" if status.homed else "not homed"
        bad = status.motion_error or status.moving
        moving = ", moving" if status.moving else ""
        error = ", motion error" if status.motion_error else ""
        how = f"{where}{moving}{error}"
        yield (_warning if bad else _ok)("stage state", how)
    yield from failed


def _stage_info(transport: Transport, timeout_s: float) -> apt.Info:
    transport.write(apt.encode(apt.Frame(apt.Message.REQUEST_INFO)))
    decoder = apt.Decoder()
    for _ in range(100):  # messages that it sends unasked
        for frame in decoder.feed(transport.read_exactly(decoder.missing_bytes, timeout_s)):
            if frame.message is apt.Message.INFO:
                return apt.read_info(frame)
    raise BadReply(f"{transport.resource} does not say what it is", "check that this is the stage")


def _finger_tracker(config: RigConfig, today: datetime.date) -> Checks:
    match config.finger_tracker:
        case EvdevFingerConfig() as screen:
            yield _touch_calibration(screen, today)
            with _failures("touch screen") as failed:
                open_touch_reports(screen.device).close()
                yield _ok("touch screen", screen.device)
            yield from failed
        case RecordedFingerConfig(file=file):
            there = Path(file).is_file()
            yield (_ok if there else _failed)(
                "finger tracker", f"plays {file}{'' if there else ': missing'}"
            )
        case StageFingerConfig():
            yield _unverified("finger tracker", "the stage carries the finger: see the stage")
        case NoFingerTracker():
            yield _unverified(
                "finger tracker", "there is none: nothing can be rendered by position"
            )
        case other:
            yield _unverified("finger tracker", f"{other.kind}: how to ask it is not known here")


def _touch_calibration(screen: EvdevFingerConfig, today: datetime.date) -> Check:
    name = "touch calibration"
    try:
        calibration = screen.touch_calibration()
    except BadInputError as error:
        return _failed(name, error.message, CALIBRATE_TOUCH)
    if calibration.placeholder:
        return _warning(name, "a placeholder", CALIBRATE_TOUCH)
    dated = _dated(name, "measured", screen.measured_at, today)
    return (
        dated
        if dated.status is CheckStatus.OK
        else dated._replace(hint=f"{dated.hint} (haptic calibrate-touch)")
    )


def _analog_output(config: RigConfig) -> Checks:
    given = config.analog_output
    if isinstance(given, NoAnalogOutput):
        carrier = config.waveform_generator.carrier
        how = "go over SCPI" if carrier is None else "are in the carrier's own samples"
        yield _ok("envelope", f"amplitudes {how}; there is no analog output for them")
        return
    said = (
        f"{given.kind} output, {given.zero_level_v:g} V for nothing: opening it would put out a"
        " level"
    )
    yield _unverified(
        "envelope", said, "measure Modulation In at low voltage: 0 V may be half the amplitude"
    )._replace(held=_untold(given, OUTPUT_FIGURES))


# --- how it is asked
# ---------------------------------------------------------------------------------------------


def _untold(section: Section, names: Iterable[str]) -> tuple[Setting, ...]:
    """Figures of the file that are computed with, of a device that does not say its own."""
    return tuple(
        Setting(name, value, None) for name in names if (value := getattr(section, name, None))
    )


def _ask(transport: Transport, question: str, timeout_s: float) -> str:
    """Only a question: what does not end with `?` is never sent."""
    if not re.fullmatch(r"[*A-Z:]+\?", question):
        raise ValueError(f"{question!r} is no question")
    return (
        transport.query(question.encode("ascii") + b"\n", timeout_s)
        .decode("ascii", errors="replace")
        .strip()
    )


class _Closable(Protocol):
    def close(self) -> object: ...


@contextmanager
def _failures(name: str, device: _Closable | None = None) -> Iterator[list[Check]]:
    """Collects what a device's failure comes to, and closes it; the list is empty when all went
    well.
    """
    failed: list[Check] = []
    try:
        yield failed
    except DeviceError as error:
        failed.append(_failed(name, error.message, error.hint))
    except ValueError as error:
        failed.append(_failed(name, str(error), "check the reply"))
    finally:
        if device is not None:
            device.close()
