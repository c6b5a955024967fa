"""The door of the port: who has not asked for anything yet costs a descriptor and a few
microseconds.

A stranger on this machine may open connections faster than a web server makes its objects for them,
and the queue of the system is then full for everybody. Here a connection is accepted and waits
until the headers of a request are there; the oldest makes room for the next. Only then it is the
server's, and one that shows the token before all others.
"""

from __future__ import annotations

import asyncio
import re
import secrets
import socket
import time
from collections.abc import Callable

MOST_STRANGERS = 256  # that wait
MOST_ENTERING = 16  # without the token, on their way to the server
MOST_HEADER_BYTES = 16 * 1024
ACCEPTED_AT_ONCE = 64
WAITING_CONNECTIONS = 1024  # that the system keeps until they are accepted
LOOK_S = 0.1  # between looks for those who are late
PAUSE_S = 0.1  # where there are no descriptors

_TOKEN = re.compile(rb"(?i:authorization: *bearer) +(\S+)|[?&]token=([^&\s]+)")


class Door:
    """Opens with the running loop; `late_s` is how long headers take.

    `make` makes the server's end of a connection, which is told what was said at the door.
    """

    def __init__(
        self,
        listener: socket.socket,
        token: str,
        make: Callable[[bytes], asyncio.Protocol],
        late_s: Callable[[], float],
    ) -> None:
        self._loop = asyncio.get_running_loop()
        self._listener = listener
        self._token = token.encode()
        self._make = make
        self._late_s = late_s
        self._strangers: dict[
            socket.socket, tuple[float, bytes]
        ] = {}  # since when, and what was said; oldest first
        self._entering: set[asyncio.Task[None]] = set()
        self._strange = 0  # of those
        listener.setblocking(False)
        listener.listen(WAITING_CONNECTIONS)
        self._loop.add_reader(listener, self._accept)
        self._timer = self._loop.call_later(LOOK_S, self._look)

    def close(self) -> None:
        """Let nobody in any more."""
        self._timer.cancel()
        self._loop.remove_reader(self._listener)
        for stream in list(self._strangers):
            self._show_out(stream)

    def _accept(self) -> None:
        for _ in range(ACCEPTED_AT_ONCE):
            try:
                stream, _ = self._listener.accept()
            except (BlockingIOError, InterruptedError, ConnectionAbortedError):
                return
            except OSError:  # no descriptors
                self._pause()
                return
            stream.setblocking(False)
            self._strangers[stream] = time.monotonic(), b""
            self._loop.add_reader(stream, self._hear, stream)
            if len(self._strangers) > MOST_STRANGERS:
                self._show_out(next(iter(self._strangers)))

    def _pause(self) -> None:
        for stream in list(self._strangers)[: len(self._strangers) // 2]:
            self._show_out(stream)
        self._loop.remove_reader(self._listener)
        self._loop.call_later(PAUSE_S, self._go_on)

    def _go_on(self) -> None:
        if not self._timer.cancelled():
            self._loop.add_reader(self._listener, self._accept)

    def _look(self) -> None:
        """The oldest come first."""
        late_s = time.monotonic() - self._late_s()
        for stream in [
            stream for stream, (since_s, _) in self._strangers.items() if since_s < late_s
        ]:
            self._show_out(stream)
        self._timer = self._loop.call_later(LOOK_S, self._look)

    def _hear(self, stream: socket.socket) -> None:
        try:
            more = stream.recv(MOST_HEADER_BYTES)
        except (BlockingIOError, InterruptedError):
            return
        except OSError:
            more = b""
        since_s, said = self._strangers[stream]
        said += more
        if b"\n\r\n" in said or b"\n\n" in said:
            self._let_in(stream, said)
        elif more and len(said) <= MOST_HEADER_BYTES:
            self._strangers[stream] = since_s, said  # in its place
        else:
            self._show_out(stream)

    def _let_in(self, stream: socket.socket, said: bytes) -> None:
        is_strange = not self._knows_token(said)
        if is_strange and self._strange >= MOST_ENTERING:
            self._show_out(stream)
            return
        del self._strangers[stream]
        self._loop.remove_reader(stream)
        self._strange += is_strange
        task = self._loop.create_task(self._enter(stream, said, is_strange))
        self._entering.add(task)
        task.add_done_callback(self._entering.discard)

    async def _enter(self, stream: socket.socket, said: bytes, is_strange: bool) -> None:
        try:
            await self._loop.connect_accepted_socket(lambda: self._make(said), stream)
        except OSError:
            stream.close()
        finally:
            self._strange -= is_strange

    def _knows_token(self, said: bytes) -> bool:
        """Whether it says so; the gate judges."""
        found = [bearer or query for bearer, query in _TOKEN.findall(said)]
        return any(secrets.compare_digest(one, self._token) for one in found)

    def _show_out(self, stream: socket.socket) -> None:
        self._loop.remove_reader(stream)
        del self._strangers[stream]
        stream.close()
