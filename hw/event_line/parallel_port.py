"""The data pins of a parallel port, through Linux's ppdev.

Requests are those of `linux/ppdev.h` on common processors; no port was tried.
"""

from __future__ import annotations

import os
from contextlib import suppress

from hw.errors import DeviceDisconnected

PPCLAIM, PPRELEASE, PPEXCL = 0x708B, 0x708C, 0x708F  # _IO('p', number)
PPWDATA = 0x40017086  # _IOW('p', 0x86, unsigned char)


class ParallelPort:
    """Pins 2 to 9, of which pin 2 is bit 0; the port is held alone."""

    def __init__(self, device: str) -> None:
        self.resource = device
        self._descriptor = -1

    def open(self) -> None:
        try:
            self._descriptor = os.open(self.resource, os.O_RDWR | os.O_CLOEXEC)
            self._ask(PPEXCL)
            self._ask(PPCLAIM)
            self._ask(PPWDATA, bytes([0]))
        except OSError as error:
            self._let_go()
            raise DeviceDisconnected(
                f"{self.resource} cannot be used ({error})",
                "load ppdev (modprobe ppdev), unload lp, and join the group that owns the device",
            ) from error

    def put(self, code: int) -> None:
        try:
            self._ask(PPWDATA, bytes([code]))
        except (OSError, ValueError) as error:  # ValueError: it is not open
            raise DeviceDisconnected(
                f"{self.resource} was lost ({error})", "open it again; look at its adapter"
            ) from error

    def close(self) -> None:
        with suppress(OSError, ValueError):
            self._ask(PPWDATA, bytes([0]))
            self._ask(PPRELEASE)
        self._let_go()

    def _ask(self, request: int, data: bytes = b"") -> None:
        import fcntl  # noqa: PLC0415 - not on Windows

        fcntl.ioctl(self._descriptor, request, data)

    def _let_go(self) -> None:
        if self._descriptor >= 0:
            with suppress(OSError):
                os.close(self._descriptor)
        self._descriptor = -1
