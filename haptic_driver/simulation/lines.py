"""What simulated instruments and control must agree on: scales, and the lines of the amplifier as
text over TCP.

    ENABLE 0|1, ENABLE?   the enable line       0 or 1, its level
    VOLTAGE?              the voltage monitor   V at its output
    ELECTRODE? f          an electrode monitor  at f Hz: real, imaginary part and 1 sigma of the
                          voltage, V, and of the current, A
    GAIN x                how much more friction than its model the finger has; of simulations alone
    THRUST x              m by which the finger comes to meet the load stage; of simulations alone
"""

from __future__ import annotations

import datetime
from collections.abc import Callable

from haptic_driver.simulation.instruments import SimulatedInstruments
from haptic_driver.simulation.pressed_finger import PressedFinger
from hw.errors import BadReply
from hw.finger.simulated_touch_screen import Panel
from hw.finger.touch_screen import TouchCalibration
from hw.monitor.contract import ElectrodeReading
from hw.transport.contract import Transport

REPLY_TIMEOUT_S = 1.0
PANEL = Panel(
    x_counts_per_m=100e3,
    y_counts_per_m=-100e3,
    x_origin_raw=50,
    y_origin_raw=6050,
    report_rate_hz=250.0,
)
SCREEN = TouchCalibration(  # counts of PANEL to metres, exact by construction
    ((1e-5, 0.0, -50e-5), (0.0, -1e-5, 6050e-5)), datetime.date(2024, 1, 1), placeholder=False
)


class LinesServer:
    """Answers for the lines of the simulated amplifier, and for the finger's gain and thrust."""

    def __init__(
        self,
        instruments: SimulatedInstruments,
        electrode: Callable[[float], ElectrodeReading | None],
        pressed: PressedFinger | None = None,
    ) -> None:
        self._instruments, self._electrode = instruments, electrode
        self._pressed = pressed

    def handle(self, data: bytes) -> bytes:
        """Carry out one line and answer it."""
        instruments = self._instruments
        amplifier = instruments.amplifier
        match data.split():
            case [b"ENABLE", (b"0" | b"1") as level]:
                amplifier.write(level == b"1")
                instruments.tell_drive()
                return b"%d\n" % amplifier.read()
            case [b"ENABLE?"]:
                return b"%d\n" % amplifier.read()
            case [b"VOLTAGE?"]:
                return b"%.9g\n" % amplifier.read_v()
            case [b"ELECTRODE?", hz] if reading := self._electrode(float(hz)):
                v, i = reading.voltage_v, reading.current_a
                told = v.real, v.imag, reading.voltage_std_v, i.real, i.imag, reading.current_std_a
                return b" ".join(b"%.9g" % value for value in told) + b"\n"
            case [(b"GAIN" | b"THRUST") as what, value]:
                self._change_finger(what, float(value))
                return value + b"\n"
        return b"ERROR\n"

    def _change_finger(self, what: bytes, value: float) -> None:
        if what == b"GAIN":
            self._instruments.finger_gain = value
        elif self._pressed is not None:
            self._pressed.thrust_m = value


class Lines:
    """Control's end: `write` and `read` are the enable line (a digital output), `read_v` the
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
