"""Instruments through VISA: GPIB, VXI-11, HiSLIP, and whatever else the VISA library of a lab can
reach.
"""

from __future__ import annotations

import math
import re
import select
import socket
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

import pyvisa
from pyvisa.constants import BufferOperation, ResourceAttribute, SerialTermination, StatusCode

from hw.errors import DeviceDisconnected, DeviceError
from hw.transport.bounded import in_time
from hw.transport.contract import CHUNK_BYTES, NO_OTHER_BOUNDS, Bounds, Transport
from hw.transport.marker import Marker, Resynchroniser

# pyvisa-py moves at most this much per system call on a socket
_SOCKET_BLOCK_BYTES = 4096
# A read on a socket of pyvisa-py spins until its timeout when the peer has hung up, so it is given
# short ones.
_SOCKET_SLICE_S = 0.1
# a live link closes in milliseconds; pyvisa-py waits up to 14 s for a dead one of VXI-11
_CLOSE_TIMEOUT_S = 0.25

_HOST = re.compile(r"TCPIP\d*::(?P<host>[^:\[,]+)", re.IGNORECASE)


class VisaTransport(Transport):
    r"""Transport over one VISA session. `backend` is what pyvisa calls the library: `@py`, `@ivi`,
    or a path.

    Answers must end with `\n` on sockets and serial ports. Clearing closes the session and opens
    another one, after a device clear where the interface has one. A serial line carries late
    answers over from one session to the next: give a `marker` (see SerialTransport). pyvisa-py
    opens closed sockets and spins on dead ones. It gives late answers to the next question and lets
    any exception through. This class handles all of these. What a library does not bound (opening,
    clearing, closing) is given up in time, and ends in a thread of its own.
    """

    def __init__(
        self,
        resource: str,
        *,
        backend: str = "@py",
        marker: Marker | None = None,
        bounds: Bounds = NO_OTHER_BOUNDS,
    ) -> None:
        super().__init__(resource, bounds=bounds)
        self._backend = backend
        self._resynchronise = None if marker is None else Resynchroniser(marker, resource)
        self._address: str | None = None  # the resource without the name of its host, once found
        self._session: Any = None
        self._socket: socket.socket | None = None  # pyvisa-py's own, where there is one

    def _connect(self, deadline_s: float) -> None:
        if self._address is None:
            self._address = self._resolved(deadline_s)
        address = self._address
        try:
            manager = pyvisa.ResourceManager(self._backend)
        except Exception as error:
            raise DeviceDisconnected(
                f"{self.resource}: no VISA library for {self._backend!r} ({error})",
                "use '@py' (pip install pyvisa-py) or install the vendor's VISA and use '@ivi'",
            ) from error
        try:
            session = in_time(
                lambda: manager.open_resource(address, open_timeout=self._remaining_ms(deadline_s)),
                self._remaining_s(deadline_s),
                too_late=_close,
            )
        except DeviceError:
            raise
        except Exception as error:
            raise self._lost("cannot be opened", error) from error
        self._session = session
        try:
            self._socket = self._own_socket()
            self._set_terminations()
            if self._socket is not None:
                self._socket.getpeername()  # pyvisa-py "opens" ports that refused
        except Exception as error:
            raise self._lost("cannot be reached", error) from error

    def _resolved(self, deadline_s: float) -> str:
        """The resource with the address of its host in place of a name; see TcpTransport."""
        named = _HOST.match(self.resource)
        if named is None:
            return self.resource
        host = named["host"]
        try:
            found = in_time(
                lambda: socket.getaddrinfo(host, None, socket.AF_INET),
                self._remaining_s(deadline_s),
            )
        except TimeoutError:
            raise self._timeout("has a name that nobody resolves") from None
        except (OSError, UnicodeError):
            return self.resource  # the library may know the name
        return self.resource.replace(host, str(found[0][4][0]), 1)

    def _own_socket(self) -> socket.socket | None:
        sessions = getattr(self._session.visalib, "sessions", {})
        interface = getattr(sessions.get(self._session.session), "interface", None)
        return interface if isinstance(interface, socket.socket) else None

    def _set_terminations(self) -> None:
        attributes = {}
        if self._kind == "SOCKET":
            attributes = {
                ResourceAttribute.termchar: ord("\n"),
                ResourceAttribute.termchar_enabled: True,
            }
            # hand over what has come when nothing more does, instead of losing it
            if self._socket is not None:
                attributes[ResourceAttribute.suppress_end_enabled] = False
                self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        elif self._is_serial:
            attributes = {
                ResourceAttribute.termchar: ord("\n"),
                ResourceAttribute.asrl_end_in: SerialTermination.termination_char,
                ResourceAttribute.asrl_end_out: SerialTermination.none,
            }
        for attribute, value in attributes.items():
            self._session.set_visa_attribute(attribute, value)

    def _disconnect(self) -> None:
        session, self._session, self._socket = self._session, None, None
        if session is not None:
            with suppress(Exception):  # a dead session may fail in any way; it is gone afterwards
                in_time(lambda: _close(session), _CLOSE_TIMEOUT_S)

    def _reset(self, deadline_s: float) -> None:
        if self._session is not None and self._kind == "INSTR" and not self._is_serial:
            with suppress(Exception):  # a fresh session follows
                self._session.timeout = self._remaining_ms(deadline_s)
                # the rest is for opening
                in_time(self._session.clear, 0.5 * self._remaining_s(deadline_s))
        super()._reset(deadline_s)
        if self._resynchronise is not None:
            self._resynchronise(
                lambda data: self._send(data, deadline_s),
                lambda: self._receive(deadline_s, CHUNK_BYTES),
                self._bounds.max_reply_bytes,
            )

    def _send(self, data: bytes, deadline_s: float) -> None:
        with self._errors("while sending"):
            session = self._connected()
            block = len(data) if self._socket is None else _SOCKET_BLOCK_BYTES
            for start in range(0, len(data), block):
                part = data[start : start + block]
                self._wait_writable(deadline_s)
                session.timeout = self._remaining_ms(deadline_s)
                written, _ = session.visalib.write(session.session, part)
                if written != len(part):
                    raise self._timeout("did not take the command")

    def _wait_writable(self, deadline_s: float) -> None:
        """pyvisa-py waits for ever for a peer that does not read."""
        if (
            self._socket is not None
            and not select.select([], [self._socket], [], self._remaining_s(deadline_s))[1]
        ):
            raise self._timeout("did not take the command")

    def _receive(self, deadline_s: float, count: int) -> bytes:
        count = min(count, self._bounds.max_reply_bytes + 1)
        while True:
            with self._errors("while waiting for the answer"):
                session = self._connected()
                remaining_s = self._remaining_s(deadline_s)
                slice_s = remaining_s if self._socket is None else min(remaining_s, _SOCKET_SLICE_S)
                session.timeout = _milliseconds(slice_s)
                try:
                    with session.ignore_warning(StatusCode.success_max_count_read):
                        data, _ = session.visalib.read(session.session, count)
                except pyvisa.errors.VisaIOError as error:
                    if error.error_code != StatusCode.error_timeout or slice_s == remaining_s:
                        raise
                    self._check_peer()
                    continue
                if data:
                    return bytes(data)

    def _check_peer(self) -> None:
        assert self._socket is not None
        if select.select([self._socket], [], [], 0)[0] and not self._socket.recv(
            1, socket.MSG_PEEK
        ):
            raise ConnectionError("closed by the peer")

    def _discard_input(self) -> None:
        with self._errors("before sending"):
            session = self._connected()
            if self._socket is not None:
                session.flush(BufferOperation.discard_receive_buffer)
                while select.select([self._socket], [], [], 0)[0]:
                    if not self._socket.recv(_SOCKET_BLOCK_BYTES):
                        raise ConnectionError("closed by the peer")
            elif self._is_serial or self._kind == "SOCKET":
                session.flush(BufferOperation.discard_read_buffer)

    @property
    def _kind(self) -> str:
        return self.resource.rpartition("::")[2].upper()

    @property
    def _is_serial(self) -> bool:
        return self.resource.upper().startswith("ASRL")

    def _connected(self) -> Any:
        if self._session is None:
            raise self._not_connected()
        return self._session

    @contextmanager
    def _errors(self, when: str) -> Iterator[None]:
        try:
            yield
        except pyvisa.errors.VisaIOError as error:
            if error.error_code == StatusCode.error_timeout:
                raise self._timeout("did not answer") from None
            raise self._lost(f"was lost {when}", error) from error
        except DeviceError:
            raise
        except Exception as error:
            raise self._lost(f"was lost {when}", error) from error

    def _remaining_ms(self, deadline_s: float) -> int:
        return _milliseconds(self._remaining_s(deadline_s))

    def _lost(self, what: str, error: Exception) -> DeviceDisconnected:
        self._disconnect()
        said = f"{self.resource} {what} ({error or type(error).__name__})"
        return DeviceDisconnected(said, "check power, cable, address and VISA library")


def _close(session: Any) -> None:
    session.close()


def _milliseconds(seconds: float) -> int:
    """At least 1: VISA reads 0 as "do not wait"."""
    return max(1, math.ceil(1e3 * seconds))
