"""Looks at a rig without energising it, and says what it could not verify.

It only asks questions: nothing is set, reset or switched, and no error queue is emptied. No line is
opened whose opening could raise it, no bias is taken, nothing moves. What only a voltage could show
stays "not verified".
"""

from __future__ import annotations

import datetime
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Any

from haptic_driver.processes.real_time import BEFORE_RENDER
from haptic_driver.rig.check import Check, Checks, Examination
from haptic_driver.rig.claims import Claims
from haptic_driver.rig.config import RigConfig
from haptic_driver.rig.roles import ROLES, KindRole


def examine(config: RigConfig, today: datetime.date) -> list[Check]:
    """All checks of a real rig, in order; never raises DeviceError. Takes a few timeouts per absent
    device.
    """
    return [
        check
        for name, examine_one in examinations(config)
        for check in Examination(name, config, today).told(examine_one)
    ]


def examinations(rig: RigConfig) -> Iterator[tuple[str, Callable[[Examination], Checks]]]:
    """Who examines what, by the name of its checks."""
    yield "configuration", _figures
    yield "resources", _resources
    for key, role in ROLES.items():
        sections = rig.sections_of(key) or ([role.unsaid] if role.unsaid else [])
        for section in sections:
            many = isinstance(role, KindRole) and role.many
            kind = getattr(section, "kind", "")
            yield f"{role.name}, {kind}" if many else role.name, section.examine
    yield "real-time scheduling", _real_time


def _figures(at: Examination) -> Checks:
    for missing in at.rig.unverified:
        said = f"{missing} unset: the rig refuses to come on"
        yield at.failed(said, "measure, then write it down")
    if at.rig.finger.velocity_time_constant_s is not None:
        said = "finger.velocity_time_constant_s is not used: the filter follows the panel's reports"
        yield at.called("finger").warning(said, "remove it from the rig's file")
    if "latency_s" not in at.rig.output.model_fields_set:
        said = "output.latency_s is left out: the finger's place is taken to be felt at once"
        hint = "write down what the instruments take; while it renders, haptic status measures it"
        yield at.called("output").warning(said, hint)
    for key, section in at.rig.signed_sections.items():
        if section.verified and section.measured_at is not None:
            name = key.rpartition(".")[2].replace("_", " ")
            what = f"measured by {section.measured_by}"
            yield at.called(f"{name} figures").dated(what, section.measured_at)


@contextmanager
def alone_with(config: RigConfig) -> Iterator[None]:
    """No other program has the instruments meanwhile: a question may disturb it, as a Net F/T box
    streams to one alone. HapticError says who has one.
    """
    claims = Claims(config.addresses)
    claims.take()
    try:
        yield
    finally:
        claims.release()


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
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(BEFORE_RENDER))
    except OSError as error:
        yield at.warning(
            f"SCHED_FIFO {BEFORE_RENDER} is refused ({error.strerror})",
            f"allow it: LimitRTPRIO={BEFORE_RENDER} in the service, or rtprio in"
            " /etc/security/limits.conf",
        )
        return
    os.sched_setscheduler(0, *before)
    yield at.ok(f"SCHED_FIFO {BEFORE_RENDER} is granted")
