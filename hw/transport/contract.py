"""The byte-level contract that every way to reach an instrument keeps."""

from __future__ import annotations

import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import NamedTuple

from hw.errors import BadReply, DeviceDisconnected, DeviceTimeout

# what is asked of a link at a time while the length of the answer is not known
CHUNK_BYTES = 1 << 16


class Bounds(NamedTuple):
    """How long opening and writing may take, and how long an answer may be."""

    open_timeout_s: float = 3.0
    write_timeout_s: float = 3.0
    max_reply_bytes: int = 1 << 20


NO_OTHER_BOUNDS = Bounds()


@contextmanager
def longer_if_slow(reply_timeout_s: float) -> Iterator[None]:
    """Have a DeviceTimeout name the key that gives a device more time, such as one that wakes."""
    try:
        yield
    except DeviceTimeout as error:
        error.hint += f"; where it is slow to wake, raise reply_timeout_s, now {reply_timeout_s:g}"
        raise


class Transport(ABC):
    """Bytes to and from one instrument, one dialogue at a time.

    One re-entrant lock is held over a whole query; `exchange` lends it to a caller who needs
    several queries undisturbed. Deadlines are monotonic. A query that did not end cleanly (timeout,
    disconnect, bytes too many) leaves the transport `dirty`. The next write first calls `clear`, so
    a late answer never goes to the next question.

    Implementations supply `_connect`, `_disconnect`, `_send`, `_receive` and `_discard_input`. They
    supply `_reset` where a fresh connection is not the way to start again. All run under the lock,
    and `deadline_s` is on the scale of `clock`.
    """

    _check_first = "that it is on and not busy"  # of a timeout's hint

    def __init__(
        self,
        resource: str,
        *,
        bounds: Bounds = NO_OTHER_BOUNDS,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.resource = resource
        self._bounds = bounds
        self._clock = clock
        self._lock = threading.RLock()
        self._received = bytearray()
        self._is_open = False
        self._dirty = False
        self._dialogue = _Dialogue(self)

    @property
    def dirty(self) -> bool:
        """True when bytes of an unfinished dialogue may still arrive."""
        return self._dirty

    def mark_dirty(self) -> None:
        """Distrust the dialogue so far, e.g. after an answer that makes no sense."""
        self._dirty = True

    @contextmanager
    def exchange(self, timeout_s: float | None = None) -> Iterator[None]:
        """Hold the transport's lock; wait for it at most `timeout_s`, or as long as it takes.

        Raises DeviceTimeout when another thread keeps the lock.
        """
        if not self._lock.acquire(timeout=-1 if timeout_s is None else timeout_s):
            raise DeviceTimeout(
                f"{self.resource} has been busy for {timeout_s:g} s",
                "another thread holds it; try again or disconnect it",
            )
        try:
            yield
        finally:
            self._lock.release()

    def open(self) -> None:
        """Connect; does nothing when already open. Raises DeviceDisconnected or DeviceTimeout."""
        with self._lock:
            if not self._is_open:
                self._connect(self._clock() + self._bounds.open_timeout_s)
                self._received.clear()
                self._is_open, self._dirty = True, False

    def close(self) -> None:
        """Disconnect; never fails, does nothing when already closed."""
        with self._lock:
            self._disconnect()
            self._is_open = False

    def clear(self) -> None:
        """Forget everything under way, so that the next answer belongs to the next question."""
        self._clear(self._clock() + self._bounds.open_timeout_s)

    def write(self, data: bytes) -> None:
        """Send bytes as they are. Raises DeviceDisconnected or DeviceTimeout."""
        self._write(data, self._clock() + self._bounds.write_timeout_s)

    def read_until(self, terminator: bytes, timeout_s: float) -> bytes:
        """Return the bytes before `terminator`, which is consumed.

        Raises DeviceTimeout, DeviceDisconnected, or BadReply when the line has no end.
        """
        return self._read_until(terminator, self._clock() + timeout_s)

    def read_exactly(self, count: int, timeout_s: float) -> bytes:
        """Return exactly `count` bytes. Raises DeviceTimeout or DeviceDisconnected."""
        deadline_s = self._clock() + timeout_s
        with self._dialogue:
            while len(self._received) < count:
                self._received += self._receive(deadline_s, count - len(self._received))
            return self._take(count)

    def query(self, line: bytes, timeout_s: float) -> bytes:
        r"""Send `line` and return the answer without its `\n`; `timeout_s` covers all of it.

        Raises what `write` and `read_until` raise; then the transport is dirty.
        """
        with self._lock:
            deadline_s = self._clock() + timeout_s
            self._write(line, deadline_s)
            return self._read_until(b"\n", deadline_s)

    @abstractmethod
    def _connect(self, deadline_s: float) -> None:
        """Establish the connection, free of old bytes."""

    @abstractmethod
    def _disconnect(self) -> None:
        """Drop the connection, if any; never raises."""

    @abstractmethod
    def _send(self, data: bytes, deadline_s: float) -> None:
        """Send all of `data`."""

    @abstractmethod
    def _receive(self, deadline_s: float, count: int) -> bytes:
        """Wait for at least one byte; raises DeviceTimeout or DeviceDisconnected, never returns
        none.

        A link must not wait for more than `count` bytes; it may return more when it has them.
        """

    @abstractmethod
    def _discard_input(self) -> None:
        """Throw away, without waiting, what has arrived unasked."""

    def _reset(self, deadline_s: float) -> None:
        """Start again on a fresh connection; bytes still under way belong to the old one."""
        self._disconnect()
        self._connect(deadline_s)

    def _clear(self, deadline_s: float) -> None:
        with self._lock:
            self._check_open()
            self._dirty = True
            self._reset(deadline_s)
            self._received.clear()
            self._dirty = False

    def _write(self, data: bytes, deadline_s: float) -> None:
        with self._dialogue:
            if self._dirty:
                self._clear(deadline_s)
            self._received.clear()
            self._discard_input()
            self._send(data, deadline_s)

    def _read_until(self, terminator: bytes, deadline_s: float) -> bytes:
        with self._dialogue:
            searched = 0
            while (end := self._received.find(terminator, searched)) < 0:
                if len(self._received) > self._bounds.max_reply_bytes:
                    raise BadReply(
                        f"{self.resource} sent {len(self._received)} bytes without a line end",
                        "check that this is the instrument, not another service",
                    )
                searched = max(0, len(self._received) - len(terminator) + 1)
                self._received += self._receive(deadline_s, CHUNK_BYTES)
            return self._take(end + len(terminator))[: -len(terminator)]

    def _remaining_s(self, deadline_s: float) -> float:
        """Time left, s; DeviceTimeout when there is none."""
        remaining_s = deadline_s - self._clock()
        if remaining_s <= 0.0:
            raise self._timeout("did not answer")
        return remaining_s

    def _timeout(self, what: str) -> DeviceTimeout:
        return DeviceTimeout(
            f"{self.resource} {what} in time", f"check {self._check_first}; then try again"
        )

    def _not_connected(self) -> DeviceDisconnected:
        return DeviceDisconnected(f"{self.resource} is not connected", "clear or open it again")

    def _check_open(self) -> None:
        if not self._is_open:
            raise DeviceDisconnected(f"{self.resource} is not open", "call open() first")

    def _take(self, count: int) -> bytes:
        taken = bytes(self._received[:count])
        del self._received[:count]
        return taken


class _Dialogue:
    """Holds a transport's lock; whatever ends the block early (an interrupt too) leaves the
    transport dirty.

    A class, because a generator as context manager costs a query over loopback a tenth of its time.
    """

    def __init__(self, transport: Transport) -> None:
        self._transport = transport

    def __enter__(self) -> None:
        self._transport._lock.acquire()
        try:
            self._transport._check_open()
        except BaseException:
            self._transport._lock.release()
            raise

    def __exit__(self, kind: type[BaseException] | None, *error: object) -> None:
        if kind is not None:
            self._transport._dirty = True
        self._transport._lock.release()
