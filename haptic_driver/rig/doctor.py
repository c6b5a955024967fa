"""Looks at a rig without energising it, and says what it could not verify.

It only asks questions: nothing is set, reset or switched, and no error queue is emptied. No line is
opened whose opening could raise it, no bias is taken, nothing moves. What only a voltage could show
stays "not verified".
"""

from __future__ import annotations

import datetime
import os
from collections.abc import Callable, Iterator
from contextlib import suppress
from typing import Any

from haptic_driver.processes.real_time import PRIORITY
from haptic_driver.rig.check import Check, Checks, Examination
from haptic_driver.rig.config import RigConfig
from haptic_driver.rig.parts.interlocks import NoInterlock


def examine(config: RigConfig, today: datetime.date) -> list[Check]:
    """All checks of a real rig, in order; never raises DeviceError. Takes a few timeouts per absent
    device.
    """
    return [
        check
        for name, examine_one in _examinations(config)
        for check in Examination(name, config, today).told(examine_one)
    ]


def _examinations(rig: RigConfig) -> Iterator[tuple[str, Callable[[Examination], Checks]]]:
    """Who examines what, by the name of its checks."""
    yield "configuration", _figures
    yield "resources", _resources
    yield "waveform generator", rig.waveform_generator.examine
    yield "amplifier", rig.amplifier.examine
    for monitor in rig.electrode_monitors:
        yield f"electrode monitor, {monitor.kind}", monitor.examine
    yield "interlock", (rig.interlock or NoInterlock()).examine
    yield "force sensor", rig.force_sensor.examine if rig.force_sensor else _no_force_sensor
    if rig.stage is not None:
        yield "stage", rig.stage.examine
    yield "load stage", rig.load_stage.examine
    yield "finger tracker", rig.finger_tracker.examine
    yield "camera", rig.camera.examine
    yield "event line", rig.event_line.examine
    yield "line in", rig.line_in.examine
    yield "envelope", rig.analog_output.examine
    yield "real-time scheduling", _real_time


def _figures(at: Examination) -> Checks:
    for missing in at.rig.unverified:
        said = f"{missing} unset: the rig refuses to come on"
        yield at.failed(said, "measure, then write it down")
    for key, section in at.rig.signed_sections.items():
        if section.verified and section.measured_at is not None:
            name = key.rpartition(".")[2].replace("_", " ")
            what = f"measured by {section.measured_by}"
            yield at.called(f"{name} figures").dated(what, section.measured_at)


def _no_force_sensor(at: Examination) -> Checks:
    yield at.failed("there is none in the rig's file", "add a section [force_sensor]")


def _resources(at: Examination) -> Checks:
    """What this machine sees; an empty list is no fault, since instruments on the LAN do not
    show.
    """
    found = [*_serial_ports(), *_usb_instruments()]
    yield at.ok(", ".join(found) or "no serial ports or USB instruments seen")


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


def _real_time(at: Examination) -> Checks:
    """Tried and taken back at once, for this process only."""
    if not hasattr(os, "sched_setscheduler"):
        said = "this system has none that is known here"
        yield at.warning(said, "run the daemon on Linux")
        return
    before = os.sched_getscheduler(0), os.sched_getparam(0)
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
    except OSError as error:
        yield at.warning(
            f"SCHED_FIFO {PRIORITY} is refused ({error.strerror})",
            f"allow it: LimitRTPRIO={PRIORITY} in the service, or rtprio in"
            " /etc/security/limits.conf",
        )
        return
    os.sched_setscheduler(0, *before)
    yield at.ok(f"SCHED_FIFO {PRIORITY} is granted")
