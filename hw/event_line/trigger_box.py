"""A trigger box behind a serial port: each byte is the state of its eight wires until the next.
The other way it sends a byte for what came to it.

This is what boxes of several makers do that need no setting up; none of them was tried. They
answer nothing, so that nobody knows whether a byte has come out.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress

from hw.errors import DeviceError, DeviceTimeout
from hw.transport.contract import Transport

PATIENCE_S = 0.002  # for a byte


class TriggerBox:
    """Such a box; the transport gets one byte per code."""

    def __init__(self, transport: Transport) -> None:
        self.resource = transport.resource
        self._transport = transport

    def open(self) -> None:
        self._transport.open()
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

    def __init__(self, transport: Transport, code: int = 0) -> None:
        self.resource = transport.resource
        self._transport, self._code = transport, code

    def open(self) -> None:
        self._transport.open()

    def levels(self) -> Sequence[bool]:
        codes = bytearray()
        with suppress(DeviceTimeout):
            while True:  # what has come with the first is there at once
                codes += self._transport.read_exactly(1, 0.0 if codes else PATIENCE_S)
        edges = [code for code in codes if code and self._code in (0, code)]
        return (True, False) * len(edges)

    def close(self) -> None:
        self._transport.close()
