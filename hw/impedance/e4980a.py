"""Keysight's E4980A (and AL) LCR meter: drives the electrode itself, in place of the amplifier, and
measures impedance.

Commands are those of its User's Guide; never tried on an instrument. It has no switch for its
signal: a level of 0 V is off.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from math import hypot, sqrt

from hw.errors import BadReply, LimitExceeded
from hw.monitor.contract import ElectrodeReading, nothing
from hw.monitor.scpi_line import ScpiLine
from hw.setting import Setting, refuse_unlike
from hw.transport.contract import Transport

MODEL = re.compile(r"E4980AL?")
FREQUENCY_TOLERANCE = 1e-4  # of a step of its synthesiser; an impedance changes by as much
LEVEL_TOLERANCE = 5e-3  # of a step of its level, which is read back and measured
_LOOK = "look at the meter; is it the model of the rig's file?"
# Each is set, and read back: another function or a bias would be another number, or a voltage.
_WANTED = {
    ":BIAS:STAT": "0",
    ":FUNC:IMP:TYPE": "RX",
    ":APER": "LONG,1",
    ":TRIG:SOUR": "BUS",
    ":INIT:CONT": "1",
    ":AMPL:ALC": "0",
    ":FUNC:SMON:VAC": "1",
}


@dataclass(frozen=True)
class LcrMeter:
    """What it may do: peak volts at the electrode, carriers; `accuracy` is a share of |Z| (0.05 %
    basic).
    """

    voltage_limit_v: float = 2.0 * sqrt(2.0)
    lowest_hz: float = 20.0
    highest_hz: float = 2e6
    accuracy: float = 1e-3
    reply_timeout_s: float = 10.0


class E4980A:
    """The meter on the electrode. Its own source's phase is zero, since it measures impedance
    alone.
    """

    drives = True

    def __init__(self, transport: Transport, meter: LcrMeter) -> None:
        self.line = ScpiLine(transport, meter.reply_timeout_s)
        self._meter = meter

    @property
    def frequency_range_hz(self) -> tuple[float, float]:
        """As the rig's file says."""
        return self._meter.lowest_hz, self._meter.highest_hz

    def open(self) -> None:
        """Connect, no voltage, and set up what does not change; raises DeviceError."""
        self.line.open(MODEL)
        set_up = [f"{header} {value}" for header, value in _WANTED.items()]
        self.line.tell("*RST", ":VOLT:LEV 0", *set_up)
        self.off()
        refuse_unlike("LCR meter", self.held(), _LOOK)

    def held(self) -> list[Setting]:
        """What is to be set and what the instrument holds now; only asks."""
        return [
            Setting(header, value, _plain(self.line.ask(f"{header}?")))
            for header, value in {**_WANTED, ":VOLT:LEV": "0"}.items()
        ]

    def close(self) -> None:
        """No voltage, and hang up; raises DeviceError where the meter does not say so."""
        try:
            self.off()
        finally:
            self.line.close()

    def off(self) -> None:
        """No voltage, read back."""
        self.line.tell(":VOLT:LEV 0")
        level_v = self.line.numbers(":VOLT:LEV?", 1)[0]
        if level_v != 0.0:
            raise BadReply(
                f"LCR meter: holds {level_v:g} V after 0 V were set", "take it off the electrode"
            )

    def read(
        self, frequency_hz: float, voltage_v: float, alive: Callable[[], object] = nothing
    ) -> ElectrodeReading:
        """See `ElectrodeMonitor`: voltage and current while the meter drives the electrode."""
        low_hz, high_hz = self.frequency_range_hz
        if not (
            low_hz <= frequency_hz <= high_hz and 0.0 < voltage_v <= self._meter.voltage_limit_v
        ):
            raise LimitExceeded(
                f"LCR meter: {voltage_v:g} V at {frequency_hz:g} Hz is beyond"
                f" {self._meter.voltage_limit_v:g} V or outside {low_hz:g}..{high_hz:g} Hz; nothing"
                " was sent",
                "stay within what the rig's file allows it",
            )
        alive()
        try:
            self.line.tell(f":FREQ:CW {frequency_hz:.9g}", f":VOLT:LEV {voltage_v / sqrt(2.0):.6g}")
            self._check_got(frequency_hz, voltage_v / sqrt(2.0))
            self.line.tell(":TRIG:IMM")  # not *TRG, which answers by itself
            self.line.numbers("*OPC?", 1)
            resistance, reactance, status, *_ = self.line.numbers(":FETC:IMP:FORM?", 3)
            rms_v = self.line.numbers(":FETC:SMON:VAC?", 1)[0]
        finally:
            self.off()
        impedance = complex(resistance, reactance)
        if status != 0.0 or impedance == 0.0 or not rms_v > 0.0:
            raise BadReply(
                f"LCR meter: status {status:g}, Z {impedance}, {rms_v:g} V",
                "is the electrode wired to it?",
            )
        peak_v = sqrt(2.0) * rms_v
        current_a = peak_v / impedance
        std_a = self._meter.accuracy * hypot(current_a.real, current_a.imag)
        return ElectrodeReading(complex(peak_v), self._meter.accuracy * peak_v, current_a, std_a)

    def _check_got(self, frequency_hz: float, rms_v: float) -> None:
        """Refuse another carrier or level than was asked for; the voltage that counts is
        measured.
        """
        got_hz = self.line.numbers(":FREQ:CW?", 1)[0]
        got_v = self.line.numbers(":VOLT:LEV?", 1)[0]
        unlike = []
        if abs(got_hz - frequency_hz) > FREQUENCY_TOLERANCE * frequency_hz:
            unlike.append(Setting("frequency_hz", frequency_hz, got_hz))
        if abs(got_v - rms_v) > LEVEL_TOLERANCE * rms_v:
            unlike.append(Setting("level_v_rms", rms_v, got_v))
        refuse_unlike("LCR meter", unlike, "ask for what it can make")


def _plain(answer: str) -> str:
    """An answer as it is set: numbers without their zeros."""
    parts = []
    for part in answer.upper().split(","):
        try:
            parts.append(f"{float(part):g}")
        except ValueError:
            parts.append(part.strip())
    return ",".join(parts)
