"""A trigger box behind a serial port: each byte is the state of its eight wires until the next.
The other way it sends a byte for what came to it.

This is what boxes of several makers do that need no setting up; none of them was tried. They
answer nothing, so that nobody knows whether a byte has come out.

A box with an Arduino begins anew when its port is opened. For a second or two it takes nothing, and
then it may say so. `settle_s` after every opening it is left alone, and what it said is dropped.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from contextlib import suppress

from hw.errors import DeviceError, DeviceTimeout
from hw.transport.contract import Transport

PATIENCE_S = 0.002  # for a byte
SETTLE_S = 2.0  # of an Arduino's boot loader, with some to spare


def open_settled(transport: Transport, settle_s: float, sleep: Callable[[float], None]) -> None:
    """Open the port of a box; when this returns the box is ready, and what it said is dropped."""
    transport.open()
    if settle_s:
        sleep(settle_s)
        transport.clear()


class TriggerBox:
    """Such a box; the transport gets one byte per code."""

    def __init__(
        self,
        transport: Transport,
        settle_s: float = SETTLE_S,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        self.resource = transport.resource
        self._transport = transport
        self._settle_s, self._sleep = settle_s, sleep

    def open(self) -> None:
        open_settled(self._transport, self._settle_s, self._sleep)
        self.put(0)

    def put(self, code: int) -> None:
        """Raises ValueError for what is no byte."""
        self._transport.write(bytes([code]))

    def close(self) -> None:
        with suppress(DeviceError):
            self.put(0)
        self._transport.close()


class TriggerBoxIn:
    """A byte of the box as a line in, which is high for a moment at each that is `code`. Where that
    is 0, any other byte counts.
    """

    def __init__(
        self,
        transport: Transport,
        code: int = 0,
        settle_s: float = SETTLE_S,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        self.resource = transport.resource
        self._transport, self._code = transport, code
        self._settle_s, self._sleep = settle_s, sleep

    def open(self) -> None:
        open_settled(self._transport, self._settle_s, self._sleep)

    def levels(self) -> Sequence[bool]:
        codes = bytearray()
        with suppress(DeviceTimeout):
            while True:  # what has come with the first is there at once
                codes += self._transport.read_exactly(1, 0.0 if codes else PATIENCE_S)
        edges = [code for code in codes if code and self._code in (0, code)]
        return (True, False) * len(edges)

    def close(self) -> None:
        self._transport.close()
