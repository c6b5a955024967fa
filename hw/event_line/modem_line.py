"""RTS or DTR of a serial port as an event line of one wire, at the port's own levels."""

from __future__ import annotations

from typing import Literal

from hw.safety.interlock import ModemLine


class ModemEventLine:
    """High for every code but 0. RS-232 swings to 12 V of either sign: an adapter makes it TTL."""

    def __init__(self, port: str, signal: Literal["rts", "dtr"]) -> None:
        self._line = ModemLine(port, signal, looped_back=False)
        self.resource = self._line.resource

    def open(self) -> None:
        self._line.connect()

    def put(self, code: int) -> None:
        self._line.write(code != 0)

    def close(self) -> None:
        self._line.close()
