"""A serial port, through pyserial: interlock boxes, motor controllers, anything behind
USB-to-serial.
"""

from __future__ import annotations

import errno
from contextlib import suppress

import serial

from hw.errors import DeviceDisconnected, DeviceTimeout
from hw.transport.contract import NO_OTHER_BOUNDS, Bounds, Transport
from hw.transport.marker import Marker, Resynchroniser

_NO_SUCH_LINE = (errno.ENOTTY, errno.EINVAL)


class SerialTransport(Transport):
    """Transport over one serial port, 8N1, held exclusively.

    A line has no connection to drop, so a late answer can only be waited out. Clearing reads until
    nothing has come for `settle_s` (several shorter tries add up). An answer later than that would
    be given to the next question. With a `marker` that cannot happen: a question with an answer of
    its own is asked, and everything before that answer is dropped. Closing a port drops RTS and
    DTR, so clearing keeps it open while it works. `rts` and `dtr` are the levels at opening (some
    systems pulse both for an instant); with `rtscts` the port itself drives RTS.
    """

    _check_first = "power, cable and baud rate"

    def __init__(
        self,
        port: str,
        baud_rate: int = 115200,
        *,
        rtscts: bool = False,
        settle_s: float = 0.1,
        marker: Marker | None = None,
        bounds: Bounds = NO_OTHER_BOUNDS,
    ) -> None:
        super().__init__(f"ASRL{port}::INSTR", bounds=bounds)
        self._settings = {"baudrate": baud_rate, "rtscts": rtscts, "exclusive": True}
        self._rts = True
        self._path = port
        self._settle_s = settle_s
        self._resynchronise = None if marker is None else Resynchroniser(marker, self.resource)
        self._port: serial.Serial | None = None
        self._quiet_since_s: float | None = None  # while settling, over several tries

    def set_rts(self, high: bool) -> bool:
        """Drive RTS; False where the port has no such line (a pseudo-terminal). Raises
        DeviceDisconnected.
        """
        with self._lock:
            self._check_open()
            try:
                self._connected().rts = high
            except OSError as error:
                if error.errno in _NO_SUCH_LINE:
                    return False
                raise self._lost("did not take the line RTS", error) from error
            self._rts = high
            return True

    def _connect(self, deadline_s: float) -> None:
        try:
            port = serial.Serial(**self._settings)
            port.port = self._path
            port.rts, port.dtr = self._rts, True
            port.open()
        except (OSError, ValueError) as error:
            raise self._lost("cannot be opened", error) from error
        self._port, self._quiet_since_s = port, None

    def _disconnect(self) -> None:
        if self._port is not None:
            with suppress(OSError):
                self._port.close()
            self._port = None

    def _reset(self, deadline_s: float) -> None:
        if self._port is None:
            self._connect(deadline_s)
        if self._resynchronise is None:
            self._settle(deadline_s)
        else:
            self._resynchronise(
                lambda data: self._send(data, deadline_s),
                lambda: self._receive(deadline_s, 1),
                self._bounds.max_reply_bytes,
            )

    def _settle(self, deadline_s: float) -> None:
        """Read until the line has been quiet for `settle_s`; raises DeviceTimeout when the deadline
        is before that.

        A question may have less time than `settle_s`: what it waited then counts for the next one.
        """
        self._discard_input()
        if self._quiet_since_s is None:
            self._quiet_since_s = self._clock()
        while (settled_s := self._quiet_since_s + self._settle_s) > self._clock():
            try:
                self._receive(min(deadline_s, settled_s), 1)
                self._quiet_since_s = self._clock()
            except DeviceTimeout:
                if deadline_s < settled_s:
                    raise
        self._quiet_since_s = None

    def _send(self, data: bytes, deadline_s: float) -> None:
        port = self._connected()
        try:
            port.write_timeout = self._remaining_s(deadline_s)
            port.write(data)
        except serial.SerialTimeoutException:
            raise self._timeout("did not take the command") from None
        except OSError as error:
            raise self._lost("was lost while sending", error) from error

    def _receive(self, deadline_s: float, count: int) -> bytes:
        port = self._connected()
        try:
            port.timeout = self._remaining_s(deadline_s)
            data = bytes(port.read(max(1, port.in_waiting)))
        except OSError as error:
            raise self._lost("was lost while waiting for the answer", error) from error
        if not data:
            raise self._timeout("did not answer")
        return data

    def _discard_input(self) -> None:
        port = self._connected()
        try:
            while waiting := port.in_waiting:
                port.read(waiting)
                self._quiet_since_s = None
        except OSError as error:
            raise self._lost("was lost", error) from error

    def _connected(self) -> serial.Serial:
        if self._port is None:
            raise self._not_connected()
        return self._port

    def _lost(self, what: str, error: Exception) -> DeviceDisconnected:
        """Give the port up and say why; a port that failed once is opened afresh."""
        self._disconnect()
        return DeviceDisconnected(
            f"{self.resource} {what} ({error})",
            "check the cable, the port's name, your permission and other programs",
        )
