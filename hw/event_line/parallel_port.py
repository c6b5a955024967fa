"""Pins of a parallel port, through Linux's ppdev: data pins as an event line, a status pin as a
line in.

Requests are those of `linux/ppdev.h` on common processors; no port was tried.
"""

from __future__ import annotations

import os
from abc import ABC, abstractmethod
from collections.abc import Sequence
from contextlib import suppress

from hw.errors import DeviceDisconnected

PPCLAIM, PPRELEASE, PPEXCL = 0x708B, 0x708C, 0x708F  # _IO('p', number)
PPWDATA = 0x40017086  # _IOW('p', 0x86, unsigned char)
PPRSTATUS = 0x80017081  # _IOR('p', 0x81, unsigned char)
STATUS_BITS = {15: 0x08, 13: 0x10, 12: 0x20, 10: 0x40, 11: 0x80}  # by pin
BUSY = 11  # the port itself inverts this one


class _Port(ABC):
    """A port that is held alone between `open` and `close`."""

    def __init__(self, device: str) -> None:
        self.resource = device
        self._descriptor = -1

    def open(self) -> None:
        try:
            self._descriptor = os.open(self.resource, os.O_RDWR | os.O_CLOEXEC)
            self._ask(PPEXCL)
            self._ask(PPCLAIM)
            self._rest()
        except OSError as error:
            self._let_go()
            raise DeviceDisconnected(
                f"{self.resource} cannot be used ({error})",
                "load ppdev (modprobe ppdev), unload lp, and join the group that owns the device",
            ) from error

    def close(self) -> None:
        with suppress(OSError, ValueError):
            self._rest()
            self._ask(PPRELEASE)
        self._let_go()

    @abstractmethod
    def _rest(self) -> None:
        """What is asked of the port first, and last."""

    def _asked(self, request: int, data: bytes) -> bytes:
        """The answer; DeviceDisconnected where there is none."""
        try:
            return self._ask(request, data)
        except (OSError, ValueError) as error:  # ValueError: it is not open
            raise DeviceDisconnected(
                f"{self.resource} was lost ({error})", "open it again; look at its adapter"
            ) from error

    def _ask(self, request: int, data: bytes = b"") -> bytes:
        import fcntl  # noqa: PLC0415 - not on Windows

        return fcntl.ioctl(self._descriptor, request, data)

    def _let_go(self) -> None:
        if self._descriptor >= 0:
            with suppress(OSError):
                os.close(self._descriptor)
        self._descriptor = -1


class ParallelPort(_Port):
    """Pins 2 to 9 as an event line, of which pin 2 is bit 0."""

    def put(self, code: int) -> None:
        self._asked(PPWDATA, bytes([code]))

    def _rest(self) -> None:
        self._ask(PPWDATA, bytes([0]))


class ParallelPortIn(_Port):
    """A status pin as a line in: 10, 11, 12, 13 or 15."""

    def __init__(self, device: str, pin: int) -> None:
        super().__init__(device)
        self._pin = pin

    def levels(self) -> Sequence[bool]:
        (status,) = self._asked(PPRSTATUS, bytes(1))
        return (bool(status & STATUS_BITS[self._pin]) is not (self._pin == BUSY),)

    def _rest(self) -> None:
        """Nothing is set."""
