"""Faults between an instrument and whoever asks it, as a wrapper around any simulated
instrument.
"""

from __future__ import annotations

import enum
import threading
import time
from collections.abc import Callable

from hw.serving.responder import Disconnect, Responder


class Fault(enum.Enum):
    """What happens to a message that asks for an answer; all but HANG carry it out."""

    GARBAGE = "garbage"  # an answer of noise, with a line end
    SILENCE = "silence"  # no answer
    LATE = "late"  # the right answer, after `delay_s`
    TRUNCATED = "truncated"  # the first half of the answer, without a line end
    DISCONNECT = "disconnect"  # the first half of the answer, then the connection is closed
    HANG = "hang"  # neither carried out nor answered


class FaultyInstrument:
    """Passes messages to `core` and spoils the answers it was told to spoil. Thread-safe."""

    def __init__(self, core: Responder, *, sleep: Callable[[float], None] = time.sleep) -> None:
        self._core = core
        self._sleep = sleep
        self._lock = threading.Lock()
        self._fault: Fault | None = None
        self._remaining = 0.0
        self._delay_s = 0.0

    def inject(self, fault: Fault, *, count: float = 1, delay_s: float = 0.0) -> None:
        """Spoil the next `count` answers (`math.inf`: all until `heal`); Fault.HANG swallows
        commands till then.
        """
        with self._lock:
            self._fault, self._remaining, self._delay_s = fault, count, delay_s

    def heal(self) -> None:
        with self._lock:
            self._remaining = 0.0

    def handle(self, data: bytes) -> bytes:
        """Carry out complete messages, and spoil their answer when a fault is due; raises
        Disconnect.
        """
        fault, delay_s = self._due(data)
        if fault is Fault.HANG:
            return b""
        answer = self._core.handle(data)
        match fault:
            case Fault.GARBAGE:
                return b"\xff\x00;?#garbage\n"
            case Fault.SILENCE:
                return b""
            case Fault.LATE:
                self._sleep(delay_s)
            case Fault.TRUNCATED:
                return answer[: len(answer) // 2]
            case Fault.DISCONNECT:
                raise Disconnect(answer[: len(answer) // 2])
        return answer

    def _due(self, data: bytes) -> tuple[Fault | None, float]:
        with self._lock:
            if self._remaining < 1 or b"?" not in data:
                hangs = self._remaining >= 1 and self._fault is Fault.HANG
                return Fault.HANG if hangs else None, 0.0
            self._remaining -= 1
            return self._fault, self._delay_s
