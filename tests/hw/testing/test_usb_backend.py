from __future__ import annotations

import errno
import struct
from typing import Any

import pytest
import usb.core
import usb.util

from hw.generator.agilent_33220a.simulator import Simulated33220A
from tests.hw.instruments import IMMEDIATE
from tests.hw.testing.usb_backend import BULK_OUT, SimulatedUsbBackend

pytestmark = pytest.mark.timeout(30)


@pytest.fixture
def backend():
    generator = Simulated33220A(IMMEDIATE)
    with SimulatedUsbBackend(generator, serial_number="MY44000001") as backend:
        yield backend


@pytest.fixture
def device(backend):
    device: Any = usb.core.find(idVendor=0x0957, idProduct=0x0407, backend=backend)
    usb.util.claim_interface(device, 0)
    yield device
    usb.util.dispose_resources(device)


def out(kind: int, tag: int, size: int, attributes: int, data: bytes = b"") -> bytes:
    return struct.pack("<BBBxLBxxx", kind, tag, ~tag & 0xFF, size, attributes) + data


def command(tag: int, text: bytes) -> bytes:
    return out(1, tag, len(text), 1, text + bytes(-len(text) % 4))


@pytest.mark.parametrize(
    ("transfer", "violation"),
    [
        (b"\x01\x01\xfe", "transfer of 3 bytes"),
        (b"\x01\x01\x01\x00" + out(1, 1, 4, 1, b"abc\n")[4:], "complement 1"),
        (out(2, 1, 0, 0), "size 0"),
        (out(1, 1, 3, 1, b"abc"), "15 bytes"),  # padding missing
    ],
)
def test_a_broken_rule_halts_the_endpoint_until_the_halt_is_cleared(
    device, backend, transfer, violation
):
    for data in (transfer, command(7, b"*CLS\n")):
        with pytest.raises(usb.core.USBError) as caught:
            device.write(BULK_OUT, data)
        assert caught.value.errno == errno.EPIPE
    (said,) = backend.violations
    assert violation in said
    device.clear_halt(BULK_OUT)
    device.write(BULK_OUT, command(7, b"*CLS\n"))
