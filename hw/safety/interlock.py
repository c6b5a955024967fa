"""Enable lines that reach the amplifier over a serial port: a heartbeat interlock box, or the
port's own RTS or DTR.

The box keeps a contact in the amplifier's enable line closed only while heartbeats arrive. It does
not rely on the computer. A program that crashes or hangs, a cable pulled out and a computer without
power all look like silence. Its firmware is a few lines on any microcontroller;
`simulated_interlock.py` is a complete one.

Line protocol: 115200 baud, 8 data bits, no parity, 1 stop bit. Lines are ASCII and end with a line
feed; a carriage return in front of it is ignored. The host asks, the box answers each line with one
line:

    ID?          HAPTIC-INTERLOCK 1               what it is, version of this protocol
    BEAT n       status                           n counts 0..255 and starts again at 0
    ENABLE       status                           close the contact
    DISABLE      status                           open the contact
    STATUS?      status
    other        ERROR                            and nothing happens

    status:      ON OK n | OFF reason n           n: the last beat taken
    reason:      DISABLED   it was told so, or has just been powered
                 SILENT     no beat for 200 ms
                 SEQUENCE   a beat was lost, repeated or out of order

Beats are edges, not levels: only a number one above the last is a beat. So a host that repeats
itself (a stuck buffer, a level that stays high) is not alive. The contact opens by the box's own
clock 200 ms after the last beat, without being asked, and at once at a wrong number. It stays open
until ENABLE, which closes it only within 200 ms of a beat. While it is open, any number is taken as
the new start.
"""

from __future__ import annotations

import re
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any, Literal, NamedTuple

from hw.errors import BadReply, DeviceDisconnected, DeviceError
from hw.transport.contract import Transport

IDENTITY = "HAPTIC-INTERLOCK 1"
SILENCE_S = 0.2
BEATS = 256

_INPUTS = {"rts": "cts", "dtr": "dsr"}  # what a loop-back wire brings a modem line back to

_STATUS = re.compile(
    r"(?P<contact>ON|OFF) (?P<reason>OK|DISABLED|SILENT|SEQUENCE) (?P<beat>\d{1,3})"
)


class InterlockStatus(NamedTuple):
    """What the box says: whether its contact is closed, why not, and the last beat it took."""

    closed: bool
    reason: str
    beat: int


class HeartbeatInterlock:
    """Driver of the box: an enable line (a digital output) that must be beaten while it is high.

    `beat` belongs in the loop that is to be supervised, at least every 100 ms; a thread that beats
    by itself would supervise nothing. Every method but `rest` and `close` raises DeviceError; each
    takes at most one reply timeout, and as long again to wait for another thread.
    """

    def __init__(self, transport: Transport, *, reply_timeout_s: float = 0.05) -> None:
        self._transport = transport
        self._reply_timeout_s = reply_timeout_s
        self._next_beat = 0
        self._closed = False  # as last asked for

    def connect(self) -> None:
        """Open, check that it is such a box, and open its contact."""
        self.identify()
        self.write(False)

    def identify(self) -> None:
        """Open, and only ask whether it is such a box."""
        self._transport.open()
        identity = self._ask("ID?")
        if identity != IDENTITY:
            self._transport.mark_dirty()
            raise BadReply(
                f"{self._transport.resource} is {identity!r}, not {IDENTITY!r}",
                "check the port in the configuration",
            )

    def status(self) -> InterlockStatus:
        """What the box says of itself."""
        return self._status("STATUS?")

    def beat(self) -> None:
        """Tell the box that the output is still wanted; BadReply when it has opened a contact that
        is to be closed.
        """
        with self._transport.exchange(self._reply_timeout_s):
            number = self._next_beat
            self._next_beat = (number + 1) % BEATS
            status = self._status(f"BEAT {number}")
        if status.beat != number:
            raise BadReply(
                f"{self._transport.resource} took beat {status.beat} where {number} was sent",
                "check its cable",
            )
        if self._closed and not status.closed:
            raise BadReply(
                f"{self._transport.resource} has opened its contact ({status.reason.lower()})",
                "beat it every 50 ms, and find out why that failed",
            )

    def rest(self) -> None:
        """Nothing to do: a box whose contact is open needs no beats."""

    def times_off(self) -> int:
        """Not known without asking the box, which `beat` does."""
        return 0

    def write(self, value: bool, /) -> None:
        """Close or open the contact."""
        self._closed = False
        if value:
            self.beat()
        status = self._status("ENABLE" if value else "DISABLE")
        if status.closed is not value:
            raise BadReply(
                f"{self._transport.resource} has its contact"
                f" {'closed' if status.closed else 'open'} ({status.reason.lower()}) after being"
                " ordered otherwise",
                "beat it every 50 ms; look at the box",
            )
        self._closed = value

    def read(self) -> bool:
        """Whether the contact is closed, by the box's own word."""
        return self.status().closed

    def close(self) -> None:
        """Open the contact, if the box still listens, and hang up; silence opens it anyway."""
        with suppress(DeviceError):
            self.write(False)
        self._transport.close()

    def _status(self, line: str) -> InterlockStatus:
        reply = self._ask(line)
        match = _STATUS.fullmatch(reply)
        if match is None or (match["contact"] == "ON") is not (match["reason"] == "OK"):
            self._transport.mark_dirty()
            raise BadReply(
                f"{self._transport.resource} answered {reply!r} to {line!r}",
                "check its cable and baud rate",
            )
        return InterlockStatus(match["contact"] == "ON", match["reason"], int(match["beat"]))

    def _ask(self, line: str) -> str:
        with self._transport.exchange(self._reply_timeout_s):
            reply = self._transport.query(line.encode("ascii") + b"\n", self._reply_timeout_s)
        return reply.decode("ascii", errors="replace").strip()


class ModemLine:
    """RTS or DTR of a serial port as an enable line (a digital output).

    The port knows only what was written to it. The level itself can be read where a wire brings it
    back to an input (RTS to CTS, DTR to DSR). Declare such a wire with `looped_back`. Without that
    wire `read` raises DeviceError, so that the state is unknown and never "off". Some traps lie
    outside this program. Many systems raise both lines for a moment when a port is opened. Some
    leave them up when the program dies. A level is no heartbeat; prefer the box.
    """

    def __init__(self, port: str, line: Literal["rts", "dtr"], *, looped_back: bool) -> None:
        self.resource = f"{line.upper()} of {port}"
        self._port = port
        self._line = line
        self._looped_back = looped_back
        self._serial: Any = None
        self._lock = threading.Lock()

    def connect(self) -> None:
        """Open the port with both lines low. Raises DeviceDisconnected."""
        import serial  # noqa: PLC0415 - only where a rig has such a line

        try:
            connection = serial.Serial()
            connection.port = self._port
            connection.rts = connection.dtr = False
            connection.open()
        except (OSError, ValueError) as error:  # SerialException is an OSError
            raise DeviceDisconnected(
                f"{self.resource}: the port cannot be opened ({error})",
                "check the port's name and permissions",
            ) from error
        self._serial = connection

    def write(self, value: bool, /) -> None:
        """Set the line. Raises DeviceDisconnected."""
        with self._lock, self._port_errors():
            setattr(self._connected(), self._line, value)

    def read(self) -> bool:
        """The level that comes back; raises DeviceError where nothing brings it back."""
        if not self._looped_back:
            raise DeviceError(
                f"{self.resource}: its level cannot be read back",
                f"wire {self._line.upper()} to {_INPUTS[self._line].upper()} and configure"
                " looped_back",
            )
        with self._lock, self._port_errors():
            return bool(getattr(self._connected(), _INPUTS[self._line]))

    def close(self) -> None:
        """Lower the line, if the port is still there, and close it."""
        with suppress(DeviceError):
            self.write(False)
        if self._serial is not None:
            with suppress(OSError):
                self._serial.close()
            self._serial = None

    def _connected(self) -> Any:
        if self._serial is None:
            raise DeviceDisconnected(f"{self.resource} is not open", "call connect() first")
        return self._serial

    @contextmanager
    def _port_errors(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            raise DeviceDisconnected(
                f"{self.resource} was lost ({error})",
                "check the adapter; a pseudo-terminal has no such line",
            ) from error
