"""From the name of an instrument to the transport that reaches it."""

# ruff: noqa: PLC0415 - pyvisa, pyusb and pyserial are imported only for who uses them

from __future__ import annotations

import difflib
import re

from hw.transport.contract import Transport
from hw.transport.marker import Marker
from hw.transport.tcp import TcpTransport

FORMS = (
    "TCPIP::host::5025::SOCKET",
    "USB0::0x0957::0x0407::SERIAL::0::INSTR",
    "ASRL/dev/ttyUSB0::INSTR",
    "/dev/ttyUSB0",
    "TCPIP::host::inst0::INSTR",
    "GPIB0::10::INSTR",
    "visa:TCPIP::host::5025::SOCKET",
)

_SERIAL = re.compile(r"(ASRL)?(?P<port>/[^:]+|COM\d+)(::INSTR)?", re.IGNORECASE)
_VISA = re.compile(
    r"GPIB\d*(::\d+){1,2}(::INSTR)?|ASRL\d+(::INSTR)?|TCPIP\d*::(\[[\da-f:.]+\]|[^:]+)(::[a-z][\w,]*)?::INSTR",
    re.IGNORECASE,
)
_VISA_PREFIX = "visa:"


def make_transport(
    resource: str,
    *,
    visa_backend: str = "@py",
    baud_rate: int = 115200,
    rtscts: bool = False,
    marker: Marker | None = None,
) -> Transport:
    """Return a transport to `resource`, by our own link where there is one, else through VISA; not
    yet open.

    `visa:` before a resource sends it through VISA in any case. `visa_backend` is what pyvisa calls
    its library, `baud_rate` and `rtscts` (flow control) concern our serial ports and `marker`
    serial lines either way. Raises ValueError for a name of no known form.
    """
    name = resource.strip()
    through_visa = name.lower().startswith(_VISA_PREFIX)
    if through_visa or _VISA.fullmatch(name):
        from hw.transport.visa import VisaTransport

        name = name[len(_VISA_PREFIX) :] if through_visa else name
        is_serial = name.upper().startswith("ASRL")
        return VisaTransport(name, backend=visa_backend, marker=marker if is_serial else None)
    if serial := _SERIAL.fullmatch(name):
        from hw.transport.serial import SerialTransport

        return SerialTransport(serial["port"], baud_rate, rtscts=rtscts, marker=marker)
    if name.upper().startswith("TCPIP"):
        return TcpTransport.from_resource(name)
    if name.upper().startswith("USB"):
        from hw.transport.usbtmc import UsbTmcTransport

        return UsbTmcTransport.from_resource(name)
    (nearest,) = difflib.get_close_matches(name, FORMS, n=1, cutoff=0.0)
    raise ValueError(f"{resource!r} names no instrument; the nearest valid form is {nearest!r}")
