"""The door of the API: it answers OFF itself, and hands the connections of all others on.

A door has the public address, so OFF is the same URL for everybody, and no client has to find a
second one. It is a thread with an accept queue of its own that waits for nobody and shares nothing
with the web server. So OFF is heard while an event loop hangs, is flooded, or has ended.

A door only looks at the head of a request (`MSG_PEEK`). Where it says OFF the door answers.
Otherwise the connection, from which nothing was taken, is the next that `Handed.accept` gives the
web server. A connection carries one request (`security.OneRequest`), so that no OFF comes on one
that was handed on.

A client without the token may open connections faster than they can be served. So a connection
without a request costs a descriptor and a few microseconds, and the oldest makes room for the next.
One that shows the token is handed on before all others.
"""

from __future__ import annotations

import asyncio
import fcntl
import math
import re
import secrets
import select
import socket
import struct
import termios
import threading
import time
from collections import deque
from concurrent.futures import Future
from contextlib import suppress
from functools import partial
from typing import Any, NamedTuple

from haptic_driver.daemon.web.off import Answered, OffThreads, as_http, begins_off
from haptic_driver.daemon.web.security import TokenGate

HEAD_TIMEOUT_S = 2.0  # from the connection to the end of the head; and for reading an answer to OFF
MOST_HEAD_BYTES = 16 * 1024
MOST_WAITING = 256  # connections whose head has not come
MOST_KNOWN, MOST_STRANGERS = 64, 16  # handed on, but not taken yet: with the token, and without
AT_ONCE = 64
WAITING_CONNECTIONS = 1024  # that the system keeps until they are accepted
LOOK_S = 0.1  # between looks for those who are late
UNREAD_S = 2.0  # so long a client may take nothing of what was sent to it
FULL = 0.25  # of what the system keeps for it: the size of a message counts differently there

_TOKEN = re.compile(rb"(?i:authorization: *bearer) +(\S+)|[?&]token=([^&\s]+)")


class Handed(socket.socket):
    """What a web server takes for its listening socket: it accepts what a door has let in.

    It is readable where there is one. Those who know the token come first.
    """

    def __init__(self) -> None:
        self._wake, woken = socket.socketpair()
        self._wake.setblocking(False)
        super().__init__(fileno=woken.detach())
        self._known: deque[socket.socket] = deque()
        self._strangers: deque[socket.socket] = deque()
        self._taken: dict[socket.socket, tuple[int, float]] = {}  # bytes unread, and since when

    def give(self, stream: socket.socket, is_known: bool) -> bool:
        """Whether there was room for it; it is the web server's then."""
        queue, most = (self._known, MOST_KNOWN) if is_known else (self._strangers, MOST_STRANGERS)
        if len(queue) >= most:
            return False
        queue.append(stream)
        self._wake.send(b".")
        return True

    def listen(self, _backlog: int = 0) -> None:
        """A door listens."""

    def accept(self) -> tuple[socket.socket, Any]:
        """The next one, and no address. Raises BlockingIOError where there is none."""
        if not self.recv(1):
            raise ConnectionAbortedError
        stream = (self._known or self._strangers).popleft()
        self._taken[stream] = 0, time.monotonic()
        return stream, ""

    def close(self) -> None:
        self._wake.close()
        for stream in [*self._known, *self._strangers]:
            stream.close()
        super().close()

    async def cut_unread(self) -> None:
        """For ever, in the web server's loop: cut what nobody reads, or it is kept for ever."""
        while True:
            await asyncio.sleep(LOOK_S)
            now_s = time.monotonic()
            for stream, (before, since_s) in list(self._taken.items()):
                if stream.fileno() < 0:
                    del self._taken[stream]
                    continue
                with suppress(OSError):
                    unread, most = _unread_bytes(stream)
                    is_read = unread <= FULL * most or unread < before
                    self._taken[stream] = unread, now_s if is_read else since_s
                    if not is_read and now_s - since_s > UNREAD_S:
                        stream.shutdown(socket.SHUT_RDWR)


def _unread_bytes(stream: socket.socket) -> tuple[int, int]:
    """What the system keeps of what was sent (SIOCOUTQ), and the most that it would keep."""
    unread: int = struct.unpack("i", fcntl.ioctl(stream, termios.TIOCOUTQ, bytes(4)))[0]
    return unread, stream.getsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF)


class _Caller(NamedTuple):
    stream: socket.socket
    until_s: float  # shown out then
    is_answered: bool = False  # what else it says is read and forgotten


class Door:
    """One listening socket, from `run` to `close`; with a `gate` that knows a token, or for all."""

    def __init__(
        self, listener: socket.socket, gate: TokenGate | None, off: OffThreads, handed: Handed
    ) -> None:
        self._listener, self._gate, self._off, self._handed = listener, gate, off, handed
        self._callers: dict[int, _Caller] = {}  # by descriptor, in the order of `until_s`
        self._answered: deque[socket.socket] = deque()
        self._deaf_until_s = math.inf  # accepts nobody until then; inf: it accepts
        self._ending = threading.Event()
        self._poll = select.epoll()
        listener.setblocking(False)
        listener.listen(WAITING_CONNECTIONS)
        self._poll.register(listener, select.EPOLLIN)

    def close(self) -> None:
        """Let `run` end."""
        self._ending.set()

    def run(self) -> None:
        """Answer and hand on."""
        while not self._ending.is_set():
            try:
                self._turn(self._poll.poll(LOOK_S, AT_ONCE), time.monotonic())
            except Exception:  # without memory anything may fail; the next turn may not
                self._ending.wait(LOOK_S)
        self._poll.close()
        for descriptor in list(self._callers):
            self._callers.pop(descriptor).stream.close()

    def _turn(self, ready: list[tuple[int, int]], now_s: float) -> None:
        for descriptor, _ in ready:
            if descriptor == self._listener.fileno():
                self._accept(now_s)
            elif (caller := self._callers.get(descriptor)) is not None:
                try:
                    self._hear(caller)
                except Exception:  # without memory; its last answer is sent once more
                    if descriptor in self._callers:
                        self._poll.modify(descriptor, select.EPOLLIN | select.EPOLLET)
        while self._answered:
            self._expect(_Caller(self._answered.popleft(), now_s + HEAD_TIMEOUT_S, True))
        while self._callers and (oldest := next(iter(self._callers.values()))).until_s < now_s:
            self._show_out(oldest)
        if self._deaf_until_s < now_s:
            self._deaf_until_s = math.inf
            self._poll.modify(self._listener, select.EPOLLIN)

    def _accept(self, now_s: float) -> None:
        for _ in range(AT_ONCE):
            try:
                stream, _ = self._listener.accept()
            except (BlockingIOError, InterruptedError, ConnectionAbortedError):
                return
            except OSError:  # no descriptors
                self._make_room(now_s)
                return
            stream.setblocking(False)
            self._expect(_Caller(stream, now_s + HEAD_TIMEOUT_S))
            if len(self._callers) > MOST_WAITING:
                self._show_out(next(iter(self._callers.values())))

    def _make_room(self, now_s: float) -> None:
        for caller in list(self._callers.values())[: len(self._callers) // 2]:
            self._show_out(caller)
        self._poll.modify(self._listener, 0)
        self._deaf_until_s = now_s + LOOK_S

    def _expect(self, caller: _Caller) -> None:
        """Hear it when it says more: what it has said already stays where it is."""
        self._callers[caller.stream.fileno()] = caller
        self._poll.register(caller.stream, select.EPOLLIN | select.EPOLLET)

    def _hear(self, caller: _Caller) -> None:
        stream = caller.stream
        try:
            said = stream.recv(MOST_HEAD_BYTES, 0 if caller.is_answered else socket.MSG_PEEK)
        except (BlockingIOError, InterruptedError):
            return
        except OSError:
            said = b""
        if not said:
            self._show_out(caller)
            return
        if caller.is_answered:
            return
        is_whole = b"\n\r\n" in said or b"\n\n" in said
        is_known = self._gate is None or (is_whole and self._knows_token(said))
        verb = begins_off(said) if is_known else None
        if verb is not None and (self._gate is None or self._gate.lets(said)):
            self._forget(stream)
            self._off.ask(verb).add_done_callback(partial(self._answer, stream))
        elif is_whole:
            self._hand_on(caller, is_known)
        elif len(said) >= MOST_HEAD_BYTES:
            self._show_out(caller)

    def _knows_token(self, said: bytes) -> bool:
        """Whether it says so; the gate judges."""
        assert self._gate is not None
        token = self._gate.token.encode()
        found = [bearer or query for bearer, query in _TOKEN.findall(said)]
        return any(secrets.compare_digest(one, token) for one in found)

    def _answer(self, stream: socket.socket, answer: Future[Answered]) -> None:
        """In a thread of its own; the client hangs up then, or is not waited for."""
        with suppress(OSError):
            stream.settimeout(UNREAD_S)
            stream.sendall(as_http(answer.result()))
            stream.shutdown(socket.SHUT_WR)
        stream.setblocking(False)
        self._answered.append(stream)

    def _hand_on(self, caller: _Caller, is_known: bool) -> None:
        self._forget(caller.stream)
        try:
            is_taken = self._handed.give(caller.stream, is_known)
        except OSError:  # the web server has ended
            is_taken = False
        if not is_taken:
            caller.stream.close()

    def _forget(self, stream: socket.socket) -> None:
        del self._callers[stream.fileno()]
        self._poll.unregister(stream)

    def _show_out(self, caller: _Caller) -> None:
        self._forget(caller.stream)
        caller.stream.close()
