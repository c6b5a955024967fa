"""One suite over every transport."""

from __future__ import annotations

import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from typing import Any

import pytest

from hw.errors import BadReply, DeviceDisconnected, DeviceTimeout
from hw.serving.memory import MemoryTransport
from hw.serving.responder import Disconnect
from hw.serving.serial import SerialServer
from hw.serving.tcp import TcpServer
from hw.transport.contract import Bounds, Transport
from hw.transport.serial import SerialTransport
from hw.transport.tcp import TcpTransport
from hw.transport.usbtmc import UsbTmcTransport
from hw.transport.visa import VisaTransport
from tests.hw.instruments import closed_port
from tests.hw.testing.usb_backend import SimulatedUsbBackend

pytestmark = pytest.mark.timeout(60)

KINDS = ["memory", "tcp", "serial", "usbtmc", "visa-tcp", "visa-serial"]
LONG = bytes(range(256)) * 280  # 71,680 bytes of every value: more than one transfer holds
LONGEST_REPLY = 75_000
QUESTIONS = 300  # of a thread
SWITCH_S = 1e-5  # between threads, or without a wire one would be done before the other begins
LATE_GONE = threading.Event()

ANSWERS = {
    b"TWO?": b"first\nsecond\n",
    b"RAW?": b"\x00\n\xff\rnext line\n",
    b"LATE?": b"late\n",
    b"PARTIAL?": b"+1.0",
    b"ENDLESS?": b"x" * 140_000,
    b"LONG?": LONG + b"\n",
    b"BARE?": b"\x00\x01\x02\x03",
}


class Instrument:
    """Answers `ECHO? x` with x, `BLOCK? #...` with the length and sum of its bytes, and misbehaves
    on request.
    """

    def handle(self, data: bytes) -> bytes:
        verb, _, rest = data.removesuffix(b"\n").removesuffix(b"\r").partition(b" ")
        if verb == b"GOODBYE?":
            raise Disconnect(b"+1.")
        if verb == b"LATE?":
            time.sleep(0.15)
            LATE_GONE.set()
        if verb == b"BLOCK?":
            return b"%d,%d\n" % (len(rest), sum(rest))
        return rest + b"\n" if verb == b"ECHO?" else ANSWERS.get(verb, b"")


def echo_marker(number: int) -> tuple[bytes, bytes]:
    return b"ECHO? marker %d\n" % number, b"marker %d" % number


def build(kind: str, stack: ExitStack) -> Transport:
    """A transport of `kind`, not yet open, to an Instrument that lives as long as `stack`."""
    limit: dict[str, Any] = {"bounds": Bounds(max_reply_bytes=LONGEST_REPLY)}
    match kind:
        case "tcp":
            server = stack.enter_context(TcpServer(Instrument()))
            return TcpTransport(server.host, server.port, **limit)
        case "visa-tcp":
            return VisaTransport(stack.enter_context(TcpServer(Instrument())).resource, **limit)
        case "serial":
            path = stack.enter_context(SerialServer(Instrument())).path
            return SerialTransport(path, marker=echo_marker, **limit)
        case "visa-serial":
            resource = stack.enter_context(SerialServer(Instrument())).resource
            return VisaTransport(resource, marker=echo_marker, **limit)
        case "usbtmc":
            backend = stack.enter_context(SimulatedUsbBackend(Instrument()))
            return UsbTmcTransport(0x0957, 0x0407, "SIM0001", backend=backend, **limit)
    return MemoryTransport(Instrument(), clock=time.monotonic, **limit)


@pytest.fixture(params=KINDS)
def transport(request):
    with ExitStack() as stack:
        transport = build(request.param, stack)
        transport.open()
        stack.callback(transport.close)
        yield transport


def test_a_query_returns_the_line_without_its_end(transport):
    assert transport.query(b"ECHO? hello\n", 5.0) == b"hello"
    assert not transport.dirty


def test_write_then_read_until_and_read_exactly(transport):
    transport.write(b"RAW?\n")
    assert transport.read_exactly(4, 5.0) == b"\x00\n\xff\r"
    assert transport.read_until(b"line\n", 5.0) == b"next "


def test_bytes_without_a_line_end_are_read_by_their_count(transport):
    transport.write(b"BARE?\n")
    assert transport.read_exactly(4, 5.0) == b"\x00\x01\x02\x03"


def test_a_long_answer_arrives_whole(transport):
    transport.write(b"LONG?\n")
    assert transport.read_exactly(len(LONG) + 1, 20.0) == LONG + b"\n"
    assert transport.query(b"ECHO? next\n", 5.0) == b"next"


def test_a_long_binary_command_arrives_whole(transport):
    block = LONG.replace(b"\n", b"\x00")
    command = b"BLOCK? #6%06d" % len(block) + block + b"\n"
    # 8 bytes of header, and what their characters sum to: # 6 0 7 1 6 8 0
    wanted = b"%d,%d" % (len(LONG) + 8, 280 * (255 * 128 - 10) + sum(b"#6071680"))
    assert transport.query(command, 20.0) == wanted


def test_silence_is_a_timeout_and_the_next_query_works(transport):
    with pytest.raises(DeviceTimeout, match=transport.resource):
        transport.query(b"NOTHING?\n", 0.1)
    assert transport.dirty
    assert transport.query(b"ECHO? again\n", 5.0) == b"again"
    assert not transport.dirty


def test_a_late_answer_is_never_given_to_the_next_question(transport):
    LATE_GONE.clear()
    with pytest.raises(DeviceTimeout):
        transport.query(b"LATE?\n", 0.05)
    assert transport.query(b"ECHO? mine\n", 5.0) == b"mine"
    assert LATE_GONE.wait(30.0)
    time.sleep(0.05)  # for it to arrive
    assert transport.query(b"ECHO? mine too\n", 5.0) == b"mine too"


def test_an_answer_nobody_asked_for_is_dropped(transport):
    assert transport.query(b"TWO?\n", 5.0) == b"first"
    assert transport.query(b"ECHO? mine\n", 5.0) == b"mine"


def test_half_an_answer_is_a_timeout_and_is_dropped(transport):
    with pytest.raises(DeviceTimeout):
        transport.query(b"PARTIAL?\n", 0.1)
    assert transport.query(b"ECHO? whole\n", 5.0) == b"whole"


def test_a_line_without_end_is_refused(transport):
    with pytest.raises(BadReply, match="without"):
        transport.query(b"ENDLESS?\n", 20.0)
    assert transport.query(b"ECHO? fine\n", 20.0) == b"fine"


def test_a_hang_up_in_mid_answer_is_a_disconnect_and_the_next_query_reconnects(transport):
    with pytest.raises(DeviceDisconnected, match=transport.resource):
        transport.query(b"GOODBYE?\n", 5.0)
    assert transport.dirty
    assert transport.query(b"ECHO? back\n", 5.0) == b"back"


def test_a_closed_transport_refuses_and_can_be_opened_again(transport):
    transport.close()
    transport.close()
    for use in (
        lambda: transport.query(b"ECHO? x\n", 1.0),
        lambda: transport.write(b"x\n"),
        lambda: transport.read_exactly(1, 1.0),
        transport.clear,
    ):
        with pytest.raises(DeviceDisconnected, match="not open"):
            use()
    transport.open()
    transport.open()
    assert transport.query(b"ECHO? x\n", 5.0) == b"x"


@pytest.fixture
def eager_threads():
    usual_s = sys.getswitchinterval()
    sys.setswitchinterval(SWITCH_S)
    yield
    sys.setswitchinterval(usual_s)


@pytest.mark.usefixtures("eager_threads")
def test_threads_get_their_own_answers(transport):
    def ask(thread: int) -> list[bytes]:
        return [transport.query(b"ECHO? %d-%d\n" % (thread, i), 30.0) for i in range(QUESTIONS)]

    with ThreadPoolExecutor(2) as pool:
        answers = list(pool.map(ask, range(2)))
    assert answers == [[b"%d-%d" % (thread, i) for i in range(QUESTIONS)] for thread in range(2)]


def test_an_exchange_keeps_other_threads_out(transport):
    with ThreadPoolExecutor(1) as pool:
        with transport.exchange():
            other = pool.submit(transport.query, b"ECHO? other\n", 5.0)
            assert transport.query(b"ECHO? one\n", 5.0) == b"one"
            assert transport.query(b"ECHO? two\n", 5.0) == b"two"
            assert not other.done()
        assert other.result(10.0) == b"other"


def test_waiting_for_a_busy_transport_is_bounded(transport):
    def wait() -> None:
        with transport.exchange(timeout_s=0.05):
            pytest.fail("the lock was not held")

    with (
        ThreadPoolExecutor(1) as pool,
        transport.exchange(),
        pytest.raises(DeviceTimeout, match="busy"),
    ):
        pool.submit(wait).result(10.0)


NOBODY = {
    "tcp": lambda: TcpTransport("127.0.0.1", closed_port()),
    "serial": lambda: SerialTransport("/dev/no-such-port"),
    "visa-tcp": lambda: VisaTransport(f"TCPIP::127.0.0.1::{closed_port()}::SOCKET"),
    "visa-serial": lambda: VisaTransport("ASRL/dev/no-such-port::INSTR"),
}


@pytest.mark.parametrize("kind", NOBODY)
def test_nobody_there_is_a_disconnect_at_open(kind):
    transport = NOBODY[kind]()
    with pytest.raises(DeviceDisconnected) as caught:
        transport.open()
    assert transport.resource in caught.value.message
    assert caught.value.hint
    with pytest.raises(DeviceDisconnected, match="not open"):
        transport.query(b"ECHO? x\n", 1.0)
    transport.close()
