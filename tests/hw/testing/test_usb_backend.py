from __future__ import annotations

import errno
import struct
import threading
from collections.abc import Iterator
from typing import Any

import pytest
import usb.core
import usb.util

from hw.generator.agilent_33220a.simulator import Simulated33220A
from tests.hw.instruments import IMMEDIATE
from tests.hw.testing.usb_backend import BULK_IN, BULK_OUT, INTERRUPT_IN, SimulatedUsbBackend

pytestmark = pytest.mark.timeout(30)


@pytest.fixture
def backend() -> Iterator[SimulatedUsbBackend]:
    generator = Simulated33220A(IMMEDIATE)
    with SimulatedUsbBackend(generator, serial_number="MY44000001") as backend:
        yield backend


@pytest.fixture
def device(backend: SimulatedUsbBackend) -> Iterator[Any]:
    device: Any = usb.core.find(idVendor=0x0957, idProduct=0x0407, backend=backend)
    usb.util.claim_interface(device, 0)
    yield device
    usb.util.dispose_resources(device)


def out(kind: int, tag: int, size: int, attributes: int, data: bytes = b"") -> bytes:
    return struct.pack("<BBBxLBxxx", kind, tag, ~tag & 0xFF, size, attributes) + data


def command(tag: int, text: bytes) -> bytes:
    return out(1, tag, len(text), 1, text + bytes(-len(text) % 4))


def test_the_descriptors_are_those_of_a_usbtmc_instrument(device):
    assert (device.manufacturer, device.product, device.serial_number) == (
        "Agilent Technologies",
        "33220A",
        "MY44000001",
    )
    (interface,) = device.get_active_configuration()
    assert (
        interface.bInterfaceClass,
        interface.bInterfaceSubClass,
        interface.bInterfaceProtocol,
    ) == (0xFE, 3, 1)
    assert [endpoint.bEndpointAddress for endpoint in interface] == [
        BULK_OUT,
        BULK_IN,
        INTERRUPT_IN,
    ]


def test_an_answer_on_the_wire(device):
    device.write(BULK_OUT, command(1, b"*OPC?\n"))
    device.write(BULK_OUT, out(2, 2, 100, 0))
    assert (
        bytes(device.read(BULK_IN, 512, 5000))
        == b"\x02\x02\xfd\x00\x02\x00\x00\x00\x01\x00\x00\x001\n\x00\x00"
    )


def test_an_answer_longer_than_the_request_comes_in_parts(device):
    device.write(BULK_OUT, command(1, b"FREQ?\n"))
    parts = []
    for tag in (2, 3, 4):
        device.write(BULK_OUT, out(2, tag, 8, 0))
        reply = bytes(device.read(BULK_IN, 512, 5000))
        size, ended = struct.unpack_from("<LB", reply, 4)
        parts.append((reply[12 : 12 + size], ended))
    assert parts == [(b"+1.00000", 0), (b"00000000", 0), (b"E+03\n", 1)]


@pytest.mark.parametrize(
    ("transfer", "violation"),
    [
        (b"\x01\x01\xfe", "transfer of 3 bytes"),
        (out(1, 0, 2, 1, b"x\n\0\0"), "tag 0"),
        (b"\x01\x01\x01\x00" + out(1, 1, 4, 1, b"abc\n")[4:], "complement 1"),
        (out(1, 1, 0, 1), "size 0"),
        (out(2, 1, 0, 0), "size 0"),
        (out(1, 1, 3, 1, b"abc"), "15 bytes"),  # padding missing
        (out(1, 1, 3, 1, b"abc" + bytes(5)), "20 bytes"),
        (out(9, 1, 4, 1, b"abcd"), "message kind 9"),
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


def test_a_tag_twice_and_two_open_requests_are_refused(device, backend):
    device.write(BULK_OUT, command(1, b"*CLS\n"))
    for transfer in (command(1, b"*CLS\n"), out(2, 2, 100, 0), out(2, 3, 100, 0)):
        try:
            device.write(BULK_OUT, transfer)
        except usb.core.USBError:
            device.clear_halt(BULK_OUT)
    assert backend.violations == ["tag 1 twice", "a request while one is open"]


def test_reading_without_a_request_is_a_timeout(device):
    device.write(BULK_OUT, command(1, b"*OPC?\n"))
    with pytest.raises(usb.core.USBTimeoutError) as caught:
        device.read(BULK_IN, 512, 20)
    assert caught.value.errno == errno.ETIMEDOUT


def test_a_buffer_too_small_for_a_packet_overflows(device):
    device.write(BULK_OUT, command(1, b"*IDN?\n"))
    device.write(BULK_OUT, out(2, 2, 100, 0))
    with pytest.raises(usb.core.USBError) as caught:
        device.read(BULK_IN, 16, 5000)
    assert caught.value.errno == errno.EOVERFLOW


def test_a_new_message_cancels_an_answer_that_was_not_fetched(device):
    device.write(BULK_OUT, command(1, b"*IDN?\n"))
    device.write(BULK_OUT, command(2, b"*OPC?\n"))
    device.write(BULK_OUT, out(2, 3, 100, 0))
    assert bytes(device.read(BULK_IN, 512, 5000))[12:14] == b"1\n"


def test_the_trigger_message_triggers(device):
    device.write(BULK_OUT, command(1, b"*CLS\n"))
    device.write(BULK_OUT, out(128, 2, 0, 0))
    device.write(BULK_OUT, command(3, b"SYST:ERR?\n"))
    device.write(BULK_OUT, out(2, 4, 100, 0))
    assert (
        bytes(device.read(BULK_IN, 512, 5000))[12:16] == b"-113"
    )  # *TRG arrives, and this instrument has none


def test_the_status_byte_comes_on_the_interrupt_endpoint(device):
    assert bytes(device.ctrl_transfer(0xA1, 128, 5, 0, 3)) == b"\x01\x05\x00"
    assert bytes(device.read(INTERRUPT_IN, 2, 1000)) == b"\x85\x00"
    with pytest.raises(usb.core.USBTimeoutError):
        device.read(INTERRUPT_IN, 2, 1)
    with pytest.raises(usb.core.USBError):
        device.ctrl_transfer(0xA1, 128, 1, 0, 3)  # tags run from 2 to 127


@pytest.mark.parametrize(
    ("kind", "request_", "index"), [(0xA1, 99, 0), (0xA2, 9, BULK_IN), (0xA2, 1, 0x55)]
)
def test_unknown_requests_stall(device, kind, request_, index):
    with pytest.raises(usb.core.USBError) as caught:
        device.ctrl_transfer(kind, request_, 0, index, 8)
    assert caught.value.errno == errno.EPIPE


def test_a_clear_halts_bulk_out_and_drops_everything(device):
    device.write(BULK_OUT, out(1, 1, 8, 0, b"FREQ 250"))
    assert bytes(device.ctrl_transfer(0xA1, 5, 0, 0, 1)) == b"\x01"
    with pytest.raises(usb.core.USBError):
        device.write(BULK_OUT, command(2, b"FREQ?\n"))
    assert bytes(device.ctrl_transfer(0xA1, 6, 0, 0, 2)) == b"\x01\x00"
    device.clear_halt(BULK_OUT)
    device.write(BULK_OUT, command(3, b"FREQ?\n"))
    device.write(BULK_OUT, out(2, 4, 100, 0))
    assert bytes(device.read(BULK_IN, 512, 5000))[12:32] == b"+1.0000000000000E+03"


def test_a_pulled_cable_kills_handles_and_waiting_reads(device, backend):
    device.write(BULK_OUT, out(2, 1, 100, 0))
    pull = threading.Timer(0.05, backend.replug)
    pull.start()
    with pytest.raises(usb.core.USBError) as caught:
        device.read(BULK_IN, 512, 10_000)
    pull.join()
    assert caught.value.errno == errno.ENODEV
    again: Any = usb.core.find(idVendor=0x0957, backend=backend)
    again.write(BULK_OUT, command(1, b"*CLS\n"))
    usb.util.dispose_resources(again)


def test_a_cable_pulled_before_a_read_does_not_leave_it_waiting(device, backend):
    device.write(BULK_OUT, out(2, 1, 100, 0))
    backend.replug()
    with pytest.raises(usb.core.USBError) as caught:
        device.read(BULK_IN, 512, 500)
    assert caught.value.errno == errno.ENODEV


def test_closing_ends_the_thread():
    before = threading.active_count()
    backend = SimulatedUsbBackend(Simulated33220A())
    assert threading.active_count() == before + 1
    backend.close()
    assert threading.active_count() == before
