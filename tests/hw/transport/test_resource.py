import re

import pytest

from hw.transport.resource import FORMS, make_transport
from hw.transport.serial import SerialTransport
from hw.transport.tcp import TcpTransport
from hw.transport.usbtmc import UsbTmcTransport
from hw.transport.visa import VisaTransport


@pytest.mark.parametrize(
    ("resource", "kind", "shown"),
    [
        ("TCPIP::192.0.2.7::5025::SOCKET", TcpTransport, "TCPIP::192.0.2.7::5025::SOCKET"),
        ("/dev/ttyUSB0", SerialTransport, "ASRL/dev/ttyUSB0::INSTR"),
        (
            "USB0::0x0957::0x0407::MY44::0::INSTR",
            UsbTmcTransport,
            "USB0::0x0957::0x0407::MY44::INSTR",
        ),
        ("USB::0x957::0x407::INSTR", UsbTmcTransport, "USB0::0x0957::0x0407::INSTR"),
        (
            "TCPIP::192.0.2.7::hislip0,4880::INSTR",
            VisaTransport,
            "TCPIP::192.0.2.7::hislip0,4880::INSTR",
        ),
        (
            "TCPIP0::[2001:db8::7]::inst0::INSTR",
            VisaTransport,
            "TCPIP0::[2001:db8::7]::inst0::INSTR",
        ),
        ("TCPIP::[2001:db8::7]::5025::SOCKET", TcpTransport, "TCPIP::[2001:db8::7]::5025::SOCKET"),
        ("ASRL3::INSTR", VisaTransport, "ASRL3::INSTR"),
        ("visa:TCPIP::192.0.2.7::5025::SOCKET", VisaTransport, "TCPIP::192.0.2.7::5025::SOCKET"),
    ],
)
def test_each_form_leads_to_its_transport(resource, kind, shown):
    transport = make_transport(f" {resource}\n")
    assert type(transport) is kind
    assert transport.resource == shown


@pytest.mark.parametrize("form", FORMS)
def test_every_form_named_in_an_error_is_valid(form):
    assert make_transport(form).resource in form or form.startswith(("/", "USB"))


@pytest.mark.parametrize(
    ("resource", "nearest"),
    [
        ("TCPIP::192.0.2.7::SOCKET", "TCPIP::host::port::SOCKET"),
        (
            "USB0::0957::0407::MY44::0::INSTR",
            "USB0::0xVVVV::0xPPPP::SERIAL::0::INSTR",
        ),  # as lsusb prints ids
        ("dev/ttyUSB0", "/dev/ttyUSB0"),
        ("192.0.2.7", "::"),
    ],
)
def test_an_unknown_form_is_refused_with_the_nearest_valid_one(resource, nearest):
    with pytest.raises(ValueError, match=re.escape(nearest)) as caught:
        make_transport(resource)
    assert repr(resource) in str(caught.value)


@pytest.mark.parametrize("asked", [True, False])
def test_flow_control_reaches_the_port(asked):
    transport = make_transport("/dev/ttyUSB0", rtscts=asked)
    assert isinstance(transport, SerialTransport)
    assert transport._settings["rtscts"] is asked
