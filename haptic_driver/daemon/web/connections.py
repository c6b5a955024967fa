"""Connections to the API before HTTP: how many, how long they may take, and OFF before everything
else.
"""

from __future__ import annotations

import asyncio
import threading
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any, ClassVar

from starlette.requests import HTTPConnection
from uvicorn.protocols.http.h11_impl import H11Protocol
from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol

from haptic_driver.daemon.daemon import Daemon
from haptic_driver.daemon.verbs import Empty, Verb
from haptic_driver.daemon.web.off import begins_off
from haptic_driver.daemon.web.security import TokenGate, refusal
from haptic_driver.errors import HapticError

MOST_CONNECTIONS = 64  # at once, per listener
RESERVED = 64  # more, where there is an OFF lane: for OFF alone
HEADERS_TIMEOUT_S = 2.0
UNREAD_S = 2.0  # so long a client may leave unread what was sent to it
OFF_THREADS = 8  # for switching off alone: it never waits for a thread that another request holds

_FULL = refusal(
    503,
    HapticError(
        "busy", f"{MOST_CONNECTIONS} connections are open", "close some; OFF is still heard"
    ),
)
_SAID = {200: "OK", 409: "Conflict", 500: "Internal Server Error", 503: "Service Unavailable"}


class OffLane:
    """Answers what switches off by its first line, in threads of its own: before bodies, pools, and
    everybody else.
    """

    def __init__(self, daemon: Daemon) -> None:
        self._daemon = daemon
        self._threads = _started(ThreadPoolExecutor(OFF_THREADS, "off"))

    def begun(self, data: bytes) -> Future[bytes] | None:
        """The response to come, when a request that begins with `data` switches off."""
        verb = begins_off(data)
        return self._threads.submit(self._response, verb) if verb else None

    def close(self) -> None:
        """Begin nothing any more."""
        self._threads.shutdown(wait=False)

    def _response(self, verb: Verb[Any, Any]) -> bytes:
        try:
            return _response(200, verb.said_json(self._daemon, Empty(), "").encode())
        except HapticError as error:
            return _response(409, bytes(refusal(409, error).body))
        except Exception as error:
            said = HapticError(
                "internal", f"{type(error).__name__}: {error}", "a fault of the program"
            )
            return _response(500, bytes(refusal(500, said).body))


def _started(pool: ThreadPoolExecutor) -> ThreadPoolExecutor:
    """A pool whose threads are all there: when one is needed the machine may have none to give."""
    all_there = threading.Barrier(OFF_THREADS)
    for waiting in [pool.submit(all_there.wait) for _ in range(OFF_THREADS)]:
        waiting.result()
    return pool


class DropsUnread(asyncio.Protocol):
    """A connection that is cut where nobody reads what was sent: nothing more is queued for it
    meanwhile.

    To be mixed into a protocol with a `loop` and a `transport`.
    """

    loop: asyncio.AbstractEventLoop
    transport: asyncio.Transport
    _unread: asyncio.TimerHandle | None = None  # cuts it; while too much is queued

    def pause_writing(self) -> None:
        super().pause_writing()
        self._unread = self._unread or self.loop.call_later(UNREAD_S, self.transport.abort)

    def resume_writing(self) -> None:
        self._was_read()
        super().resume_writing()

    def connection_lost(self, exc: Exception | None) -> None:
        self._was_read()
        super().connection_lost(exc)

    def _was_read(self) -> None:
        if self._unread is not None:
            self._unread.cancel()
            self._unread = None


class Streamed(DropsUnread, WebSocketsSansIOProtocol):
    """A WebSocket."""


class Connection(DropsUnread, H11Protocol):
    """One connection: ended when the headers of a request are late, or when too many are open.

    With a `lane` some more may be open, and are heard for OFF alone. With a `gate` those who have
    not shown its token are `strangers`, in the order in which they came. A new one is always heard:
    the oldest makes room for it. `begun` is what it has said before it came here, at the door.
    """

    lane: ClassVar[OffLane | None] = None
    gate: ClassVar[TokenGate | None] = None
    begun = b""
    strangers: ClassVar[dict[Connection, None]] = {}  # of each listener its own
    _late: asyncio.TimerHandle | None = None  # ends the connection; while headers are awaited
    _is_answered = _is_extra = False  # answered: nothing that it says is heard any more

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Begin, or end at once."""
        super().connection_made(transport)
        if self.gate is not None:
            self.strangers[self] = None
            if len(self.strangers) > MOST_CONNECTIONS:
                oldest = next(iter(self.strangers))
                del self.strangers[oldest]
                oldest.transport.abort()
            self._end_later()
            if self.begun:
                self.data_received(self.begun)
            return
        self._is_extra = len(self.connections) > MOST_CONNECTIONS
        if len(self.connections) > MOST_CONNECTIONS + (RESERVED if self.lane else 0):
            transport.abort()
        else:
            self._end_later()

    def data_received(self, data: bytes) -> None:
        """OFF is answered by its first line; what else it says is read and forgotten."""
        if self._is_answered:
            return
        if self._awaits_headers:
            response = self.lane.begun(data) if self.lane else None
            if response is not None:
                self._is_answered = True
                self._stay()
                asyncio.wrap_future(response, loop=self.loop).add_done_callback(self._answer)
                return
            if self._is_extra:
                self._say(_response(503, bytes(_FULL.body)))
                return
            self._end_later()
        super().data_received(data)
        if not self._awaits_headers:
            self._stay()
        if self in self.strangers and self._is_known:
            del self.strangers[self]

    def connection_lost(self, exc: Exception | None) -> None:
        self.strangers.pop(self, None)
        self._stay()
        super().connection_lost(exc)

    @property
    def _is_known(self) -> bool:
        """Whether it has shown the token, or is a WebSocket, which ends without."""
        if self.transport.get_protocol() is not self:
            return True
        if self.gate is None or self.scope is None:
            return False
        return self.gate.knows_token(HTTPConnection(dict(self.scope)))

    @property
    def _awaits_headers(self) -> bool:
        is_upgraded = self.transport.get_protocol() is not self
        return not is_upgraded and (self.cycle is None or self.cycle.response_complete)

    def _end_later(self) -> None:
        if self._late is None:
            self._late = self.loop.call_later(HEADERS_TIMEOUT_S, self.transport.abort)

    def _stay(self) -> None:
        if self._late is not None:
            self._late.cancel()
            self._late = None

    def _answer(self, response: asyncio.Future[bytes]) -> None:
        if not response.cancelled():
            self._say(response.result())

    def _say(self, response: bytes) -> None:
        """The last that is said here; the client hangs up, or is not waited for."""
        if not self.transport.is_closing():
            self._is_answered = True
            self.transport.write(response)
            self.transport.write_eof()
            self._end_later()


def _response(status: int, body: bytes) -> bytes:
    head = (
        f"HTTP/1.1 {status} {_SAID[status]}\r\ncontent-type: application/json\r\ncontent-length:"
        f" {len(body)}\r\n"
    )
    return head.encode() + b"connection: close\r\n\r\n" + body
