"""A trigger box behind a serial port: each byte is the state of its eight wires until the next.

This is what boxes of several makers do that need no setting up; none of them was tried. They
answer nothing, so that nobody knows whether a byte has come out.
"""

from __future__ import annotations

from contextlib import suppress

from hw.errors import DeviceError
from hw.transport.contract import Transport


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
