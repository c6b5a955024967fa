"""The far end of `hw.amplifier.served_lines`, and what simulations alone may do to the finger.

GAIN x                how much more friction than its model the finger has
THRUST x              m by which the finger comes to meet the load stage
"""

from __future__ import annotations

from collections.abc import Callable

from haptic_driver.simulation.instruments import SimulatedInstruments
from haptic_driver.simulation.pressed_finger import PressedFinger
from hw.monitor.contract import ElectrodeReading


class LinesServer:
    """Answers for the lines of the simulated amplifier, and for the finger's gain and thrust."""

    def __init__(
        self,
        instruments: SimulatedInstruments,
        electrode: Callable[[float, float], ElectrodeReading | None],
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
            case [b"ELECTRODE?", hz] if reading := self._electrode(
                float(hz), instruments.voltage_v
            ):
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
