"""What simulated instruments and control must agree on: scales, and the lines of the amplifier as text over TCP.

ENABLE 0|1, ENABLE?   the enable line       0 or 1, its level
VOLTAGE?              the voltage monitor   V at its output
GAIN x                how much more friction than its model the finger has; a knob of the simulation, not of a rig
"""

from __future__ import annotations

import datetime
from collections.abc import Callable

from hw.amplifier.simulated import SimulatedAmplifier
from hw.errors import BadReply
from hw.finger.simulated_touch_screen import Panel
from hw.finger.touch_screen import TouchCalibration
from hw.force.net_ft import NetFtScale
from hw.transport.contract import Transport

REPLY_TIMEOUT_S = 1.0
SCALE = NetFtScale(counts_per_n=1e6, counts_per_n_m=1e6)
PANEL = Panel(x_counts_per_m=100e3, y_counts_per_m=-100e3, x_origin_raw=50, y_origin_raw=6050, report_rate_hz=250.0)
SCREEN = TouchCalibration(  # counts of PANEL to metres, exact by construction
    ((1e-5, 0.0, -50e-5), (0.0, -1e-5, 6050e-5)), datetime.date(2024, 1, 1), placeholder=False
)


class LinesServer:
    """Answers for the amplifier's lines; `changed` is called after each write, `set_gain` for a new finger."""

    def __init__(
        self, amplifier: SimulatedAmplifier, changed: Callable[[], object], set_gain: Callable[[float], object]
    ) -> None:
        self._amplifier = amplifier
        self._changed = changed
        self._set_gain = set_gain

    def handle(self, data: bytes) -> bytes:
        """Carry out one line and answer it."""
        match data.split():
            case [b"ENABLE", (b"0" | b"1") as level]:
                self._amplifier.write(level == b"1")
                self._changed()
                return self._level()
            case [b"ENABLE?"]:
                return self._level()
            case [b"VOLTAGE?"]:
                return b"%.9g\n" % self._amplifier.read_v()
            case [b"GAIN", gain]:
                self._set_gain(float(gain))
                return gain + b"\n"
        return b"ERROR\n"

    def _level(self) -> bytes:
        return b"%d\n" % self._amplifier.read()


class Lines:
    """Control's end: `write` and `read` are the enable line (a digital output), `read_v` the voltage monitor."""

    def __init__(self, transport: Transport) -> None:
        self._transport = transport

    def write(self, value: bool, /) -> None:
        """Set the enable line. Raises DeviceError."""
        self._ask(b"ENABLE %d" % value)

    def read(self) -> bool:
        """The level of the enable line. Raises DeviceError."""
        return self._ask(b"ENABLE?") == 1.0

    def read_v(self) -> float:
        """The voltage monitor, V. Raises DeviceError."""
        return self._ask(b"VOLTAGE?")

    def set_gain(self, gain: float) -> None:
        """Give the simulated finger `gain` times the friction of its model. Raises DeviceError."""
        self._ask(b"GAIN %.9g" % gain)

    def close(self) -> None:
        """Hang up."""
        self._transport.close()

    def _ask(self, line: bytes) -> float:
        with self._transport.exchange(REPLY_TIMEOUT_S):
            self._transport.open()
            reply = self._transport.query(line + b"\n", REPLY_TIMEOUT_S)
        try:
            return float(reply)
        except ValueError as error:
            self._transport.mark_dirty()
            raise BadReply(
                f"{self._transport.resource} answered {reply!r} to {line!r}", "restart the daemon"
            ) from error
