from __future__ import annotations

import re
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext

import pytest
import pyvisa

from hw.errors import DeviceDisconnected, DeviceTimeout
from hw.transport.contract import Bounds
from hw.transport.visa import VisaTransport

pytestmark = pytest.mark.timeout(30)


@contextmanager
def peer(behaviour: Callable[[socket.socket], None]) -> Iterator[str]:
    """A TCP server for one connection that does what `behaviour` says; yields its resource name."""
    with socket.create_server(("127.0.0.1", 0)) as server:

        def serve() -> None:
            with server.accept()[0] as connection:
                behaviour(connection)

        thread = threading.Thread(target=serve, daemon=True)
        thread.start()
        yield f"TCPIP::127.0.0.1::{server.getsockname()[1]}::SOCKET"
        thread.join(10.0)


def test_a_peer_that_hangs_up_without_a_word_is_a_disconnect_long_before_the_timeout():
    def hang_up(connection: socket.socket) -> None:
        connection.recv(100)

    with peer(hang_up) as resource:
        transport = VisaTransport(resource)
        transport.open()
        start = time.process_time()
        with pytest.raises(DeviceDisconnected, match="closed by the peer"):
            transport.query(b"*IDN?\n", 20.0)
        assert time.process_time() - start < 5.0  # pyvisa-py alone spins for the whole timeout
        transport.close()


def test_clearing_a_dead_peer_does_not_hang():
    with peer(lambda connection: None) as resource:
        transport = VisaTransport(resource, bounds=Bounds(open_timeout_s=1.0))
        transport.open()
    with pytest.raises(DeviceDisconnected):  # the port is closed by now
        transport.clear()
    transport.close()


def test_a_peer_that_does_not_read_is_a_timeout():
    done = threading.Event()
    with peer(lambda connection: done.wait(20.0) and None) as resource:
        transport = VisaTransport(resource, bounds=Bounds(write_timeout_s=0.2))
        transport.open()
        with pytest.raises(DeviceTimeout):
            transport.write(bytes(30_000_000))
        transport.close()
        done.set()


def test_an_unknown_library_says_what_to_install():
    with pytest.raises(
        DeviceDisconnected, match=re.escape("no VISA library for '@nosuch'")
    ) as caught:
        VisaTransport("GPIB0::10::INSTR", backend="@nosuch").open()
    assert "pyvisa-py" in caught.value.hint


def test_a_resource_that_the_library_cannot_parse_is_a_disconnect():
    with pytest.raises(DeviceDisconnected, match="cannot be opened"):
        VisaTransport("NONSENSE").open()


class Session:
    """A session of a VISA library that behaves as `does` says: by method, what to call."""

    session = 0
    timeout = 0

    def __init__(self, **does: Callable[[], object]) -> None:
        self.does = does
        self.visalib = self

    def read(self, session: int, count: int) -> tuple[bytes, int]:
        self.does.get("read", lambda: None)()
        return b"1\n", 0

    def write(self, session: int, data: bytes) -> tuple[int, int]:
        self.does.get("write", lambda: None)()
        return len(data), 0

    def clear(self) -> None:
        self.does.get("clear", lambda: None)()

    def close(self) -> None:
        self.does.get("close", lambda: None)()

    def ignore_warning(self, *codes: object) -> AbstractContextManager[None]:
        return nullcontext()


@contextmanager
def library(
    monkeypatch: pytest.MonkeyPatch, opens: Callable[[], Session]
) -> Iterator[VisaTransport]:
    """A transport over a VISA library whose sessions are what `opens` makes."""

    class Manager:
        def __init__(self, backend: str) -> None:
            pass

        def open_resource(self, resource: str, **options: object) -> Session:
            return opens()

    monkeypatch.setattr(pyvisa, "ResourceManager", Manager)
    transport = VisaTransport("TCPIP::host::hislip0::INSTR", bounds=Bounds(open_timeout_s=1.0))
    yield transport
    transport.close()


def fails() -> None:
    raise RuntimeError("hislip: connection dropped")


@pytest.mark.parametrize("step", ["read", "write"])
def test_a_dropped_link_that_raises_what_it_likes_is_a_disconnect(monkeypatch, step):
    with library(
        monkeypatch, lambda: Session(**{step: fails, "close": fails, "clear": fails})
    ) as transport:
        transport.open()
        with pytest.raises(DeviceDisconnected, match="connection dropped"):
            transport.query(b"*IDN?\n", 1.0)
        transport.clear()


def test_closing_and_clearing_a_link_that_does_not_answer_is_given_up(monkeypatch):
    """pyvisa-py waits 7 to 14 s for the answers of a dead VXI-11 link; here they never come."""
    answered = threading.Event()
    with library(
        monkeypatch, lambda: Session(close=answered.wait, clear=answered.wait)
    ) as transport:
        transport.open()
        transport.clear()
        transport.close()
        assert not answered.is_set()
        answered.set()


def test_a_link_that_opens_too_late_is_a_disconnect_and_is_closed(monkeypatch):
    may_open, closed = threading.Event(), threading.Event()

    def opens() -> Session:
        may_open.wait()
        return Session(close=closed.set)

    with library(monkeypatch, opens) as transport:
        with pytest.raises(DeviceDisconnected, match="cannot be opened"):
            transport.open()
        may_open.set()
        assert closed.wait(20.0)
