"""Modem lines of a serial port, at the port's own levels. RTS or DTR is an event line of one wire,
CTS or DSR a line in.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from typing import Any, Literal

from hw.errors import DeviceDisconnected
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


class ModemLineIn:
    """RTS and DTR of the port are high meanwhile, which feeds a button between one of them and the
    input.
    """

    def __init__(self, port: str, signal: Literal["cts", "dsr"]) -> None:
        self.resource = f"{signal.upper()} of {port}"
        self._path, self._signal = port, signal
        self._port: Any = None

    def open(self) -> None:
        import serial  # noqa: PLC0415 - only where a rig has such a line

        try:
            port = serial.Serial()
            port.port = self._path
            port.rts = port.dtr = True
            port.open()
        except (OSError, ValueError) as error:  # SerialException is an OSError
            raise DeviceDisconnected(
                f"{self.resource}: the port cannot be opened ({error})",
                "check the port's name and permissions",
            ) from error
        self._port = port

    def levels(self) -> Sequence[bool]:
        if self._port is None:
            raise DeviceDisconnected(f"{self.resource} is not open", "open it first")
        try:
            return (bool(getattr(self._port, self._signal)),)
        except OSError as error:
            raise DeviceDisconnected(
                f"{self.resource} was lost ({error})",
                "check the adapter; a pseudo-terminal has no such line",
            ) from error

    def close(self) -> None:
        if self._port is not None:
            with suppress(OSError):
                self._port.close()
            self._port = None
