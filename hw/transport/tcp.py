"""A raw TCP socket: newline-terminated SCPI, port 5025 on most LAN instruments."""

from __future__ import annotations

import re
import select
import socket
import time
from collections.abc import Callable
from contextlib import suppress
from typing import Any

from hw.errors import DeviceDisconnected
from hw.transport.bounded import in_time
from hw.transport.contract import CHUNK_BYTES, NO_OTHER_BOUNDS, Bounds, Transport

_RESOURCE = re.compile(
    r"TCPIP\d*::(?P<host>\[[\da-f:.]+\]|[^:]+)::(?P<port>\d{1,5})::SOCKET", re.IGNORECASE
)

_Address = tuple[int, tuple[Any, ...]]


class TcpTransport(Transport):
    """Transport over one TCP connection; clearing means reconnecting, since a stream has no message
    bounds.

    A host's name is resolved when it is opened for the first time, and never again: that is long
    before anything is on. A name server knows no timeout, and must not be on the way to OFF.

    The socket never blocks: waiting is a `poll` with the time that is left. A socket with a timeout
    of its own costs system calls of its own per query.
    """

    def __init__(
        self,
        host: str,
        port: int,
        *,
        bounds: Bounds = NO_OTHER_BOUNDS,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        super().__init__(f"TCPIP::{host}::{port}::SOCKET", bounds=bounds, clock=clock)
        self._host, self._port = host.strip("[]"), port  # of IPv6
        self._found: list[_Address] = []  # where the name leads
        self._socket: socket.socket | None = None

    @classmethod
    def from_resource(cls, resource: str) -> TcpTransport:
        """Build from `TCPIP::host::port::SOCKET`, port 1..65535; raises ValueError for anything
        else.
        """
        match = _RESOURCE.fullmatch(resource.strip())
        if match is None:
            raise ValueError(f"{resource!r} is not of the form TCPIP::host::port::SOCKET")
        # the system would take it modulo 65536: another port
        if not 0 < int(match["port"]) < 1 << 16:
            raise ValueError(
                f"the port of {resource!r} must be 1..65535 in TCPIP::host::port::SOCKET"
            )
        return cls(match["host"], int(match["port"]))

    def _connect(self, deadline_s: float) -> None:
        try:
            self._found = self._found or self._resolved(deadline_s)
            connection = self._connected_to(self._found, deadline_s)
        except TimeoutError:
            raise self._timeout("could not be reached") from None
        except (OSError, UnicodeError) as error:  # UnicodeError: no such name can exist
            raise self._lost(f"cannot be reached ({error})") from error
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        connection.setblocking(False)
        self._readable, self._writable = select.poll(), select.poll()
        self._readable.register(connection, select.POLLIN)
        self._writable.register(connection, select.POLLOUT)
        self._socket = connection

    def _resolved(self, deadline_s: float) -> list[_Address]:
        found = in_time(
            lambda: socket.getaddrinfo(self._host, self._port, type=socket.SOCK_STREAM),
            self._remaining_s(deadline_s),
        )
        return [(family, address) for family, _, _, _, address in found]

    def _connected_to(self, found: list[_Address], deadline_s: float) -> socket.socket:
        """A connection to the first that answers, which is the only one from then on. Raises
        OSError.
        """
        failed = OSError("no address")
        for family, address in found:
            connection = socket.socket(family, socket.SOCK_STREAM)
            try:
                connection.settimeout(self._remaining_s(deadline_s))
                connection.connect(address)
            except OSError as error:
                connection.close()
                failed = error
            except BaseException:
                connection.close()
                raise
            else:
                self._found = [(family, address)]
                return connection
        raise failed

    def _disconnect(self) -> None:
        if self._socket is not None:
            with suppress(OSError):
                self._socket.close()
            self._socket = None

    def _send(self, data: bytes, deadline_s: float) -> None:
        connection = self._connected()
        unsent = memoryview(data)
        while unsent:
            try:
                unsent = unsent[connection.send(unsent) :]
            except BlockingIOError:
                if not self._writable.poll(1e3 * self._remaining_s(deadline_s)):
                    raise self._timeout("did not take the command") from None
            except OSError as error:
                raise self._lost(f"was lost while sending ({error})") from error

    def _receive(self, deadline_s: float, count: int) -> bytes:
        connection = self._connected()
        if not self._readable.poll(1e3 * self._remaining_s(deadline_s)):
            raise self._timeout("did not answer")
        return self._take_from(connection, "was lost while waiting for the answer")

    def _take_from(self, connection: socket.socket, what: str) -> bytes:
        try:
            data = connection.recv(CHUNK_BYTES)
        except OSError as error:
            raise self._lost(f"{what} ({error})") from error
        if not data:
            raise self._lost("closed the connection")
        return data

    def _discard_input(self) -> None:
        connection = self._connected()
        while self._readable.poll(0):
            self._take_from(connection, "was lost")

    def _connected(self) -> socket.socket:
        if self._socket is None:
            raise self._not_connected()
        return self._socket

    def _lost(self, what: str) -> DeviceDisconnected:
        return DeviceDisconnected(f"{self.resource} {what}", "check power, cable and address")
