"""One suite over every transport."""

from __future__ import annotations

import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor

import pytest

from hw.errors import BadReply, DeviceDisconnected, DeviceError, DeviceTimeout
from hw.simulated.faults import Disconnect
from hw.simulated.tcp_server import TcpServer
from hw.transport.contract import Transport
from hw.transport.memory import MemoryTransport
from hw.transport.tcp import TcpTransport

pytestmark = pytest.mark.timeout(30)


ANSWERS = {
    b"TWO?": b"first\nsecond\n",
    b"RAW?": b"\x00\n\xff\rnext line\n",
    b"LATE?": b"late\n",
    b"PARTIAL?": b"+1.0",
    b"ENDLESS?": b"x" * 5000,
}


class Instrument:
    """Answers `ECHO? x` with x, and misbehaves on request."""

    def handle(self, data: bytes) -> bytes:
        verb, _, rest = data.strip().partition(b" ")
        if verb == b"GOODBYE?":
            raise Disconnect(b"+1.")
        if verb == b"LATE?":
            time.sleep(0.3)
        return rest + b"\n" if verb == b"ECHO?" else ANSWERS.get(verb, b"")


@pytest.fixture
def instrument() -> Instrument:
    return Instrument()


@pytest.fixture(params=["tcp", "memory"])
def transport(request: pytest.FixtureRequest, instrument: Instrument) -> Iterator[Transport]:
    if request.param == "memory":
        memory = MemoryTransport(instrument, max_reply_bytes=1000)
        memory.open()
        yield memory
        memory.close()
        return
    with TcpServer(instrument) as server:
        tcp = TcpTransport(server.host, server.port, max_reply_bytes=1000)
        tcp.open()
        yield tcp
        tcp.close()


def test_a_query_returns_the_line_without_its_end(transport: Transport) -> None:
    assert transport.query(b"ECHO? hello\n", 5.0) == b"hello"
    assert not transport.dirty


def test_write_then_read_until_and_read_exactly(transport: Transport) -> None:
    transport.write(b"RAW?\n")
    assert transport.read_exactly(4, 5.0) == b"\x00\n\xff\r"
    assert transport.read_until(b"line\n", 5.0) == b"next "


def test_silence_is_a_timeout_and_the_next_query_works(transport: Transport) -> None:
    with pytest.raises(DeviceTimeout, match=transport.resource):
        transport.query(b"NOTHING?\n", 0.1)
    assert transport.dirty
    assert transport.query(b"ECHO? again\n", 5.0) == b"again"
    assert not transport.dirty


def test_a_late_answer_is_never_given_to_the_next_question(transport: Transport) -> None:
    with pytest.raises(DeviceTimeout):
        transport.query(b"LATE?\n", 0.1)
    assert transport.query(b"ECHO? mine\n", 5.0) == b"mine"
    time.sleep(0.4)  # let the late answer go out
    assert transport.query(b"ECHO? mine too\n", 5.0) == b"mine too"


def test_an_answer_nobody_asked_for_is_dropped(transport: Transport) -> None:
    assert transport.query(b"TWO?\n", 5.0) == b"first"
    assert transport.query(b"ECHO? mine\n", 5.0) == b"mine"


def test_half_an_answer_is_a_timeout_and_is_dropped(transport: Transport) -> None:
    with pytest.raises(DeviceTimeout):
        transport.query(b"PARTIAL?\n", 0.1)
    assert transport.query(b"ECHO? whole\n", 5.0) == b"whole"


def test_a_line_without_end_is_refused(transport: Transport) -> None:
    with pytest.raises(BadReply, match="without a line end"):
        transport.query(b"ENDLESS?\n", 5.0)
    assert transport.query(b"ECHO? fine\n", 5.0) == b"fine"


def test_a_hang_up_in_mid_answer_is_a_disconnect_and_the_next_query_reconnects(transport: Transport) -> None:
    with pytest.raises(DeviceDisconnected, match=transport.resource):
        transport.query(b"GOODBYE?\n", 5.0)
    assert transport.dirty
    assert transport.query(b"ECHO? back\n", 5.0) == b"back"


def test_a_closed_transport_refuses_and_can_be_opened_again(transport: Transport) -> None:
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


def test_an_error_says_what_where_and_what_to_do(transport: Transport) -> None:
    with pytest.raises(DeviceError) as caught:
        transport.query(b"NOTHING?\n", 0.05)
    assert caught.value.code == "device_timeout"
    assert transport.resource in caught.value.message
    assert caught.value.hint


def test_threads_get_their_own_answers(transport: Transport) -> None:
    def ask(thread: int) -> list[bytes]:
        return [transport.query(b"ECHO? %d-%d\n" % (thread, i), 10.0) for i in range(200)]

    with ThreadPoolExecutor(4) as pool:
        answers = list(pool.map(ask, range(4)))
    assert answers == [[b"%d-%d" % (thread, i) for i in range(200)] for thread in range(4)]


def test_an_exchange_keeps_other_threads_out(transport: Transport) -> None:
    with ThreadPoolExecutor(1) as pool:
        with transport.exchange():
            other = pool.submit(transport.query, b"ECHO? other\n", 5.0)
            assert transport.query(b"ECHO? one\n", 5.0) == b"one"
            assert transport.query(b"ECHO? two\n", 5.0) == b"two"
            assert not other.done()
        assert other.result(10.0) == b"other"


def test_waiting_for_a_busy_transport_is_bounded(transport: Transport) -> None:
    def wait() -> None:
        with transport.exchange(timeout_s=0.05):
            pytest.fail("the lock was not held")

    with ThreadPoolExecutor(1) as pool, transport.exchange(), pytest.raises(DeviceTimeout, match="busy"):
        pool.submit(wait).result(10.0)
