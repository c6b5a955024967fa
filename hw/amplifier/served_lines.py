"""The lines of a simulated amplifier as text over TCP: the driver's end, and the far end.

ENABLE 0|1, ENABLE?   the enable line       0 or 1, its level
VOLTAGE?              the voltage monitor   V at its output
ELECTRODE? f          an electrode monitor  at f Hz: real, imaginary part and 1 sigma of the
                      voltage, V, and of the current, A

Whoever serves the lines may know more words, each with a number: changes of what is simulated.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

from hw.errors import BadReply
from hw.monitor.contract import ElectrodeReading, nothing

if TYPE_CHECKING:
    from hw.amplifier.simulated import SimulatedAmplifier
    from hw.transport.contract import Transport

REPLY_TIMEOUT_S = 1.0


class ServedLines:
    """The driver's end: `write` and `read` are the enable line (a digital output), `read_v` the
    voltage monitor.
    """

    def __init__(self, transport: Transport) -> None:
        self._transport = transport

    def write(self, value: bool, /) -> None:
        """Set the enable line. Raises DeviceError."""
        self._ask(b"ENABLE %d" % value)

    def read(self) -> bool:
        """The level of the enable line. Raises DeviceError."""
        return self._ask(b"ENABLE?") == [1.0]

    def read_v(self) -> float:
        """The voltage monitor, V. Raises DeviceError."""
        return self._ask(b"VOLTAGE?")[0]

    def read_electrode(self, frequency_hz: float) -> ElectrodeReading:
        """The readings of the electrode monitors at a carrier that one of them measures. Raises
        DeviceError.
        """
        v_real, v_imaginary, v_std, i_real, i_imaginary, i_std = self._ask(
            b"ELECTRODE? %.9g" % frequency_hz, 6
        )
        return ElectrodeReading(
            complex(v_real, v_imaginary), v_std, complex(i_real, i_imaginary), i_std
        )

    def close(self) -> None:
        self._transport.close()

    def _ask(self, line: bytes, count: int = 1) -> list[float]:
        with self._transport.exchange(REPLY_TIMEOUT_S):
            self._transport.open()
            reply = self._transport.query(line + b"\n", REPLY_TIMEOUT_S)
        try:
            told = [float(word) for word in reply.split()]
            if len(told) != count:
                raise ValueError
            return told
        except ValueError as error:
            self._transport.mark_dirty()
            raise BadReply(
                f"{self._transport.resource} answered {reply!r} to {line!r}", "restart the daemon"
            ) from error


class ServedMonitor:
    """What reads the electrode of a simulated rig at the carriers of one monitor of its file."""

    drives = False

    def __init__(self, lines: ServedLines, range_hz: tuple[float, float]) -> None:
        self.frequency_range_hz = range_hz
        self._lines = lines

    def read(
        self, frequency_hz: float, voltage_v: float, alive: Callable[[], object] = nothing
    ) -> ElectrodeReading:
        return self._lines.read_electrode(frequency_hz)

    def close(self) -> None:
        self._lines.close()


class LinesServer:
    """The far end: answers by the simulated amplifier, and by what its electrode shows at a
    carrier, None where nothing is simulated.

    `switched` hears that the enable line was set. `changes` are done with the number told, by word.
    """

    def __init__(
        self,
        amplifier: SimulatedAmplifier,
        electrode: Callable[[float], ElectrodeReading | None],
        switched: Callable[[], object],
        changes: Mapping[bytes, Callable[[float], object]],
    ) -> None:
        self._amplifier, self._electrode = amplifier, electrode
        self._switched, self._changes = switched, changes

    def handle(self, data: bytes) -> bytes:
        """Carry out one line and answer it."""
        match data.split():
            case [b"ENABLE", (b"0" | b"1") as level]:
                self._amplifier.write(level == b"1")
                self._switched()
                return b"%d\n" % self._amplifier.read()
            case [b"ENABLE?"]:
                return b"%d\n" % self._amplifier.read()
            case [b"VOLTAGE?"]:
                return b"%.9g\n" % self._amplifier.read_v()
            case [b"ELECTRODE?", hz] if reading := self._electrode(float(hz)):
                v, i = reading.voltage_v, reading.current_a
                told = v.real, v.imag, reading.voltage_std_v, i.real, i.imag, reading.current_std_a
                return b" ".join(b"%.9g" % value for value in told) + b"\n"
            case [word, value] if change := self._changes.get(word):
                change(float(value))
                return value + b"\n"
        return b"ERROR\n"
