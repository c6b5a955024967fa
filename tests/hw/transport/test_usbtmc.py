"""USBTMC rules, and independent clients over the same simulated device."""

from __future__ import annotations

import errno
import importlib
import struct
import sys
import warnings
from collections.abc import Callable, Iterator
from typing import Any

import pytest
import usb.backend.libusb1
import usb.core

from hw.errors import BadReply, DeviceDisconnected, DeviceTimeout
from hw.generator.agilent_33220a.simulator import Simulated33220A
from hw.transport.contract import Bounds
from hw.transport.resource import make_transport
from hw.transport.usbtmc import UsbTmcTransport
from hw.transport.visa import VisaTransport
from tests.hw.instruments import IMMEDIATE
from tests.hw.testing.usb_backend import SimulatedUsbBackend

pytestmark = pytest.mark.timeout(30)


class Echo:
    """Answers what comes after `?`; and, to SUM?, how many bytes came and what they sum to."""

    def __init__(self) -> None:
        self.heard: list[bytes] = []

    def handle(self, data: bytes) -> bytes:
        self.heard.append(data)
        if data == b"*STB?\n":
            return b"68\n"
        verb, _, rest = data.removesuffix(b"\n").partition(b"?")
        if verb == b"SUM":
            return b"%d,%d\n" % (len(rest), sum(rest))
        return rest + b"\n" if verb == b"" else b""


class SpyingBackend(SimulatedUsbBackend):
    """Keeps every Bulk-OUT transfer and control request; `spoil` changes replies, `deaf` times
    Bulk-OUT out.
    """

    def __init__(self, core: Any, **settings: Any) -> None:
        self.out: list[bytes] = []
        self.controls: list[int] = []
        self.spoil: Callable[[bytes], bytes] = lambda reply: reply
        self.deaf = False
        super().__init__(core, **settings)

    def bulk_write(self, dev_handle: Any, ep: int, intf: int, data: Any, timeout: int) -> int:
        if self.deaf:
            raise usb.core.USBTimeoutError("timed out", -7, errno.ETIMEDOUT)
        self.out.append(bytes(data))
        return super().bulk_write(dev_handle, ep, intf, data, timeout)

    def ctrl_transfer(
        self,
        dev_handle: Any,
        bmRequestType: int,
        bRequest: int,
        wValue: int,
        wIndex: int,
        data: Any,
        timeout: int,
    ) -> int:
        self.controls.append(bRequest)
        return super().ctrl_transfer(
            dev_handle, bmRequestType, bRequest, wValue, wIndex, data, timeout
        )

    def reply(self, tag: int, payload: bytes, *, last: bool) -> bytes:
        return self.spoil(super().reply(tag, payload, last=last))


@pytest.fixture
def backend():
    with SpyingBackend(Echo()) as backend:
        yield backend


@pytest.fixture
def transport(backend):
    transport = UsbTmcTransport(0x0957, 0x0407, "SIM0001", backend=backend)
    transport.open()
    backend.out.clear()
    backend.controls.clear()
    yield transport
    transport.close()


# --- bytes on the wire
# ---------------------------------------------------------------------------------------


def test_tags_run_from_1_to_255_and_skip_0(transport, backend):
    for _ in range(200):
        transport.query(b"?x\n", 5.0)
    tags = [transfer[1] for transfer in backend.out]
    assert tags == [i % 255 + 1 for i in range(400)]
    assert all(transfer[2] == 255 - transfer[1] for transfer in backend.out)
    assert not backend.violations


@pytest.mark.parametrize("size", [1, 4, 499, 65523, 65524, 65525, 140_001])
def test_commands_of_every_size_are_split_and_padded(transport, backend, size):
    data = (bytes(range(256)) * (size // 256 + 1))[:size]
    assert transport.query(b"SUM?" + data, 10.0) == b"%d,%d" % (size, sum(data))
    sent = [transfer for transfer in backend.out if transfer[0] == 1]
    assert [transfer[8] for transfer in sent] == [0] * (len(sent) - 1) + [
        1
    ]  # only the last ends the message
    assert all(len(transfer) % 4 == 0 for transfer in sent)
    sizes = [struct.unpack_from("<I", transfer, 4)[0] for transfer in sent]
    assert sum(sizes) == size + 4
    assert max(sizes) <= 1 << 16


@pytest.mark.parametrize("size", [498, 499, 500, 65523, 65524, 140_000])
def test_answers_of_every_size_come_whole(transport, size):
    # 500 - 1 and 65524 - 1 with the line end fill whole packets: an empty packet ends those
    # transfers
    data = b"y" * size
    assert transport.query(b"?" + data + b"\n", 10.0) == data


# --- replies that are wrong
# ----------------------------------------------------------------------------------


def with_byte(index: int, value: int) -> Callable[[bytes], bytes]:
    return lambda reply: reply[:index] + bytes([value]) + reply[index + 1 :]


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (with_byte(0, 127), "message kind 127"),
        (with_byte(1, 99), "tag 99"),
        (with_byte(2, 0), "tag"),
        (with_byte(4, 0), "size of 0"),
        (with_byte(4, 200), "announce a payload of 200"),
        (with_byte(4, 1), "announce a payload of 1"),
        (with_byte(7, 1), "size of 16777"),
        (lambda reply: reply[:5], "5 bytes, shorter than its header"),
        (lambda reply: b"", "0 bytes, shorter than its header"),
        (lambda reply: reply + bytes(4), "announce a payload"),
    ],
)
def test_a_malformed_reply_is_refused_and_the_next_is_right(transport, backend, spoil, message):
    backend.spoil = spoil
    with pytest.raises(BadReply, match=message):
        transport.query(b"?spoilt\n", 5.0)
    assert transport.dirty
    backend.spoil = lambda reply: reply
    assert transport.query(b"?right\n", 5.0) == b"right"


def test_a_message_that_never_ends_is_refused():
    class Babble(SpyingBackend):
        def reply(self, tag: int, payload: bytes, *, last: bool) -> bytes:
            self.answers += b"more"
            return super().reply(tag, payload, last=False)

    with Babble(Echo()) as babble:
        transport = UsbTmcTransport(
            0x0957, 0x0407, backend=babble, bounds=Bounds(max_reply_bytes=1000)
        )
        transport.open()
        with pytest.raises(BadReply, match="end of message"):
            transport.query(b"?x\n", 5.0)
        transport.close()


def test_an_answer_in_many_transfers_is_one_line(transport, backend):
    parts = iter([b"on", b"e l", b"ine\n"])

    def piecewise(reply: bytes) -> bytes:
        part = next(parts)
        ended = part.endswith(b"\n")
        if not ended:
            backend.answers += b"."  # there is more to ask for
        else:
            backend.answers.clear()
        header = reply[:4] + struct.pack("<IBxxx", len(part), ended)
        return header + part + bytes(-len(part) % 4)

    backend.spoil = piecewise
    assert transport.query(b"?anything\n", 5.0) == b"one line"


# --- timeouts, abort and clear
# -------------------------------------------------------------------------------


@pytest.mark.parametrize("pending_checks", [0, 3])
def test_a_read_timeout_is_aborted_drained_and_cleared(pending_checks):
    with SpyingBackend(Echo(), pending_checks=pending_checks) as backend:
        transport = UsbTmcTransport(0x0957, 0x0407, backend=backend)
        transport.open()
        with pytest.raises(DeviceTimeout):
            transport.query(b"SILENCE\n", 0.05)
        backend.controls.clear()
        assert transport.query(b"?back\n", 5.0) == b"back"
        # initiate and check abort Bulk-IN, initiate and check clear
        assert backend.controls == [3, *[4] * (pending_checks + 1), 5, *[6] * (pending_checks + 1)]
        assert not backend.violations
        transport.close()


def test_a_device_that_stays_pending_is_claimed_afresh_or_reported(backend):
    slept: list[float] = []
    transport = UsbTmcTransport(0x0957, 0x0407, backend=backend, sleep=slept.append)
    transport.open()
    backend.pending_checks = 10**9
    with pytest.raises(DeviceTimeout):
        transport.query(b"SILENCE\n", 0.05)
    with pytest.raises(BadReply, match="still pending"):
        transport.query(b"?x\n", 5.0)
    assert len(slept) <= 200
    backend.pending_checks = 0
    assert transport.query(b"?x\n", 5.0) == b"x"
    transport.close()


def test_a_device_that_takes_nothing_is_a_timeout_and_is_aborted(transport, backend):
    backend.deaf = True
    with pytest.raises(DeviceTimeout, match="did not take the command"):
        transport.query(b"?x\n", 0.1)
    backend.deaf = False
    backend.controls.clear()
    assert transport.query(b"?y\n", 5.0) == b"y"
    assert backend.controls == [1, 5, 6]  # nothing was under way, so there is no abort to wait for


def test_a_timeout_in_the_middle_of_a_long_command_drops_what_was_taken(transport, backend):
    taken = []
    write = backend.bulk_write

    def tiring(dev_handle: Any, ep: int, intf: int, data: Any, timeout: int) -> int:
        if taken:
            raise usb.core.USBTimeoutError("timed out", -7, errno.ETIMEDOUT)
        taken.append(data)
        return write(dev_handle, ep, intf, data, timeout)

    backend.bulk_write = tiring  # type: ignore[method-assign]
    with pytest.raises(DeviceTimeout):
        transport.write(b"?" + b"z" * 100_000 + b"\n")
    backend.bulk_write = write  # type: ignore[method-assign]
    assert transport.query(b"?short\n", 5.0) == b"short"
    assert backend.core.heard == [b"?short\n"]  # half a command is never carried out


def test_a_halted_endpoint_is_refused_and_cleared(transport, backend):
    backend.halted = True
    with pytest.raises(BadReply, match="refusal"):
        transport.query(b"?x\n", 5.0)
    assert transport.query(b"?y\n", 5.0) == b"y"


# --- finding the device
# --------------------------------------------------------------------------------------


def test_no_usb_library_is_explained(monkeypatch):
    import usb.backend.libusb0
    import usb.backend.openusb

    for module in (usb.backend.libusb0, usb.backend.libusb1, usb.backend.openusb):
        monkeypatch.setattr(module, "get_backend", lambda find_library=None: None)
    with pytest.raises(DeviceDisconnected, match="no USB library") as caught:
        UsbTmcTransport(0x0957, 0x0407).open()
    assert "libusb" in caught.value.hint


def test_another_serial_number_is_not_the_instrument(backend):
    with pytest.raises(DeviceDisconnected, match="SIM0001"):
        UsbTmcTransport(0x0957, 0x0407, "MY44000001", backend=backend).open()
    with pytest.raises(DeviceDisconnected, match="not connected"):
        UsbTmcTransport(0x0957, 0x0408, backend=backend).open()


def test_two_alike_need_a_serial_number():
    class Two(SimulatedUsbBackend):
        def enumerate_devices(self) -> Iterator[Any]:
            yield from (self, self)

    with (
        Two(Echo()) as two,
        pytest.raises(DeviceDisconnected, match="could be any of SIM0001, SIM0001") as caught,
    ):
        UsbTmcTransport(0x0957, 0x0407, backend=two).open()
    assert "serial number" in caught.value.hint


def test_an_interface_in_use_is_refused(transport, backend):
    with pytest.raises(DeviceDisconnected, match="EBUSY"):
        UsbTmcTransport(0x0957, 0x0407, backend=backend).open()
    assert transport.query(b"?still mine\n", 5.0) == b"still mine"


def test_an_open_that_fails_does_not_keep_the_interface(backend, monkeypatch):
    """It used to stay claimed after a timeout, so that nobody else could have it until the object
    was gone.
    """
    answered = backend.ctrl_transfer

    def ctrl_transfer(dev_handle: Any, kind: int, request: int, *rest: Any) -> int:
        if request == 5:  # INITIATE_CLEAR
            raise usb.core.USBTimeoutError("timed out", -7, errno.ETIMEDOUT)
        return answered(dev_handle, kind, request, *rest)

    failed, other = (UsbTmcTransport(0x0957, 0x0407, backend=backend) for _ in range(2))
    monkeypatch.setattr(backend, "ctrl_transfer", ctrl_transfer)
    with pytest.raises(DeviceTimeout, match="cannot be set up"):
        failed.open()
    monkeypatch.setattr(backend, "ctrl_transfer", answered)
    other.open()
    assert other.query(b"?mine\n", 5.0) == b"mine"
    other.close()


def test_a_pulled_cable_is_a_disconnect_and_the_device_is_found_again(transport, backend):
    backend.replug()
    with pytest.raises(DeviceDisconnected):
        transport.query(b"?x\n", 5.0)
    assert transport.query(b"?y\n", 5.0) == b"y"


# --- independent clients
# -------------------------------------------------------------------------------------


@pytest.fixture
def system_backend(monkeypatch):
    """The simulated device where every pyusb program looks for devices."""
    generator = Simulated33220A(IMMEDIATE)
    with SpyingBackend(generator) as backend:
        monkeypatch.setattr(usb.backend.libusb1, "get_backend", lambda find_library=None: backend)
        yield backend


@pytest.fixture
def pyvisa_py_with_usb(system_backend, monkeypatch):
    """pyvisa-py looks for a USB library once, at import; here it looks again, and forgets it
    afterwards.
    """
    from pyvisa_py.sessions import Session

    monkeypatch.setattr(Session, "_session_classes", dict(Session._session_classes))
    monkeypatch.delitem(sys.modules, "pyvisa_py.usb", raising=False)
    importlib.import_module("pyvisa_py.usb")
    return system_backend


def python_usbtmc(resource: str) -> Any:
    with warnings.catch_warnings():
        warnings.simplefilter(
            "ignore", DeprecationWarning
        )  # its own, escapes in a regular expression
        warnings.simplefilter("ignore", SyntaxWarning)
        import usbtmc
    return usbtmc.Instrument(resource)


QUESTIONS = [
    "*IDN?",
    "FREQ 250;FREQ?",
    "VOLT?",
    "FREQ?;VOLT?",
    "*OPC?",
    "*STB?",
    "*IDN?;" * 300 + "*OPC?",
]


def test_python_usbtmc_gets_the_answers_that_ours_gets(system_backend):
    theirs = python_usbtmc("USB0::0x0957::0x0407::SIM0001::INSTR")
    their_answers = [theirs.ask(question) for question in QUESTIONS]
    assert theirs.read_stb() == 0
    theirs.close()
    ours = UsbTmcTransport.from_resource(system_backend.resource)
    ours.open()
    our_answers = [ours.query(question.encode(), 5.0).decode() for question in QUESTIONS]
    ours.close()
    assert our_answers == their_answers
    assert our_answers[1] == "+2.5000000000000E+02"
    assert not system_backend.violations


def test_python_usbtmc_sends_the_bytes_that_ours_sends(monkeypatch):
    payloads = [
        b"?a\n",
        b"?ab\n",
        b"?abc\n",
        b"?" + b"d" * 511 + b"\n",
        b"?" + bytes(range(11, 256)) * 250 + b"\n",
    ]
    streams = []
    for client in ("ours", "theirs"):
        with SpyingBackend(Echo()) as backend:
            monkeypatch.setattr(
                usb.backend.libusb1, "get_backend", lambda find_library=None, it=backend: it
            )
            if client == "ours":
                ours = UsbTmcTransport(0x0957, 0x0407)
                ours.open()
                for payload in payloads:
                    ours.write(payload)
                ours.close()
            else:
                theirs = python_usbtmc("USB::0x0957::0x0407::INSTR")
                theirs.open()
                for payload in payloads:
                    theirs.write_raw(payload)
                theirs.close()
            streams.append([transfer for transfer in backend.out if transfer[0] == 1])
            assert not backend.violations
    assert streams[0] == streams[1]


def test_visa_can_be_asked_for_all_the_same(pyvisa_py_with_usb):
    transport = make_transport(f"visa:{pyvisa_py_with_usb.resource}")
    assert isinstance(transport, VisaTransport)
    transport.open()
    assert transport.query(b"*OPC?\n", 5.0) == b"1"
    transport.clear()
    assert transport.query(b"*IDN?\n", 5.0).split(b",")[1] == b"33220A"
    transport.close()
    assert not pyvisa_py_with_usb.violations


class Siglent(SpyingBackend):
    """An SDG1062X, as hcoffin-vecatom recorded it (pyvisa-py, pull request 449, 2024-09-21).

    Packets are of 64 bytes: the first transfer announces the 52 that its first packet has room for
    and sends 56; the second announces the rest of the sum and fills with zeros.
    """

    def _begin_transfer(self) -> bool:
        if self._request is None or not self.answers:
            return False
        (tag, _), self._request = self._request, None
        more = len(self.answers) > 52
        announced, sent = (52, 56) if more else (len(self.answers), len(self.answers))
        payload = bytes(self.answers[:sent])
        del self.answers[:sent]
        if not more and self.began:
            announced, payload = len(payload) + 4, payload + bytes(4)
        self.began = more
        header = struct.pack("<BBBxLBxxx", 2, tag, ~tag & 0xFF, announced, not more)
        self._transfer = bytearray(header + payload + bytes(-len(payload) % 4))
        return True

    began = False


IDENTITY = b"Siglent Technologies,SDG1062X,SDG1XDDC801438,1.01.01.33R8"


class Sdg:
    def handle(self, data: bytes) -> bytes:
        return {b"*IDN?\n": IDENTITY + b"\n", b"C1:SYNC?\n": b"C1:SYNC ON\n"}[data]


def test_a_siglent_announces_52_bytes_and_sends_56():
    with Siglent(Sdg(), vendor_id=0xF4EC, product_id=0xEE38) as backend:
        transport = UsbTmcTransport(0xF4EC, 0xEE38, backend=backend)
        transport.open()
        assert transport.query(b"*IDN?\n", 5.0) == IDENTITY
        assert transport.query(b"C1:SYNC?\n", 5.0) == b"C1:SYNC ON"
        assert transport.query(b"*IDN?\n", 5.0) == IDENTITY
        transport.close()


def test_what_a_siglent_may_nobody_else_may():
    with Siglent(Sdg()) as backend:
        transport = UsbTmcTransport(0x0957, 0x0407, backend=backend)
        transport.open()
        with pytest.raises(BadReply, match="68 bytes that announce a payload of 52"):
            transport.query(b"*IDN?\n", 5.0)
        transport.close()
