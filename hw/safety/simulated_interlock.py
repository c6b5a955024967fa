"""The heartbeat interlock box of `hw.safety.interlock`, as bytes in, bytes out, with a clock of its
own.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

IDENTITY = "HAPTIC-INTERLOCK 1"
SILENCE_S = 0.2


class SimulatedInterlock:
    """The firmware of the box. `closed` is its contact, now. `clock` may be simulated.
    Thread-safe.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._lock = threading.RLock()
        self._received = b""
        self._closed = False
        self._reason = "DISABLED"
        self._beat: int | None = None
        self._beaten_s = -float("inf")

    @property
    def closed(self) -> bool:
        """Whether the contact is closed; opens by itself when beats stop."""
        with self._lock:
            if self._closed and self._clock() - self._beaten_s > SILENCE_S:
                self._open("SILENT")
            return self._closed

    def handle(self, data: bytes) -> bytes:
        """Take bytes as they come and answer every complete line."""
        with self._lock:
            *lines, self._received = (self._received + data).split(b"\n")
            return b"".join(self._answer(line.strip()).encode() + b"\n" for line in lines)

    def _answer(self, line: bytes) -> str:
        match line.split(b" "):
            case [b"ID?"]:
                return IDENTITY
            case [b"BEAT", number] if number.isdigit() and int(number) < 256:
                self._take(int(number))
            case [b"ENABLE"]:
                self._enable()
            case [b"DISABLE"]:
                self._open("DISABLED")
            case [b"STATUS?"]:
                pass
            case _:
                return "ERROR"
        state = "ON OK" if self.closed else f"OFF {self._reason}"
        return f"{state} {self._beat or 0}"

    def _take(self, number: int) -> None:
        if self.closed and (self._beat is None or number != (self._beat + 1) % 256):
            self._open("SEQUENCE")
        else:
            self._beaten_s = self._clock()
        self._beat = number

    def _enable(self) -> None:
        if self._clock() - self._beaten_s <= SILENCE_S:
            self._closed = True
        else:
            self._open("SILENT")

    def _open(self, reason: str) -> None:
        self._closed, self._reason = False, reason
