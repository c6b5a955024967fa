"""Keysight's InfiniiVision oscilloscopes (2000, 3000, 4000 and 6000 X-Series): two channels on the
monitor lines.

The external trigger is the generator's Sync, which rises where its sine does: time 0 of a record.
An acquisition is started and polled, since one that waits for a trigger inside a command answers
nothing until its interface is cleared. Commands are those of the series' Programmer's Guides; never
tried on an instrument.
"""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from math import pi
from typing import NoReturn

import numpy as np

from hw.analog.output import Array
from hw.errors import BadReply, DeviceError, DeviceTimeout
from hw.monitor.contract import ElectrodeReading, nothing
from hw.monitor.lines import MonitorLines, Record, electrode_reading
from hw.monitor.scpi_line import ScpiLine
from hw.setting import Setting, refuse_unlike
from hw.transport.contract import Transport

MODEL = re.compile(r"[DM]SO-?X ?\d{4}[A-Z]*")
PERIODS = 20  # of the carrier in a record
LEAST_RANGE_V, MOST_RANGE_V = 0.016, 40.0  # full scale of a channel
# Of the range: beyond FULL a signal may be cut, below FAINT it drowns in steps. The next range is
# at most five times larger, where it stays above FAINT: or two would follow each other for ever.
FULL, FAINT = 0.9, 0.1
ATTEMPTS = 6  # to find the range
STEPS = 2**12  # of the high-resolution acquisition
LEVEL_STEP_V = 0.25  # a trigger level may be coarser than asked, well inside a Sync's swing
POLL_S = 0.005
_RUNNING = 1 << 3  # of :OPER:COND?

# Each is set, and read back. A probe's factor and an input of 50 ohm change the gain.
_CHANNEL = {"DISP": "1", "COUP": "DC", "OFFS": "0", "PROB": "1", "IMP": "ONEM", "INV": "0"}
_ALL = {
    ":ACQ:TYPE": "HRES",
    ":TIM:REF": "LEFT",
    ":EXT:PROB": "1",
    ":TRIG:MODE": "EDGE",
    ":TRIG:SWE": "NORM",
    ":TRIG:EDGE:SOUR": "EXT",
    ":TRIG:EDGE:SLOP": "POS",
    ":TRIG:EDGE:COUP": "DC",
}


@dataclass(frozen=True)
class Oscilloscope:
    """How it is wired: channels of the voltage and the current monitor, and the carriers for which
    it is asked.

    `trigger_level_v`: between the two levels of the generator's Sync, 0 V and some 3 V.
    """

    voltage_channel: int = 1
    current_channel: int = 2
    lowest_hz: float = 100.0
    highest_hz: float = 2e6
    reply_timeout_s: float = 2.0
    trigger_level_v: float = 1.2


class InfiniiVision:
    """Reads both monitor lines of an amplifier at once; each channel's range follows its signal."""

    drives = False

    def __init__(
        self,
        transport: Transport,
        wiring: Oscilloscope,
        lines: MonitorLines,
        *,
        clock: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        self.line = ScpiLine(transport, wiring.reply_timeout_s)
        self._wiring, self.lines = wiring, lines
        self._channels = wiring.voltage_channel, wiring.current_channel
        self._range_v = dict.fromkeys(self._channels, 1.0)
        self._clock, self._sleep = clock, sleep

    @property
    def frequency_range_hz(self) -> tuple[float, float]:
        """As the rig's file says."""
        return self._wiring.lowest_hz, self._wiring.highest_hz

    def open(self) -> None:
        """Connect and set up what does not change, all of it read back; raises DeviceError."""
        self.line.open(MODEL)
        set_up = [f"{header} {value}" for header, value in self._wanted().items()]
        self.line.tell("*RST", ":STOP", *set_up)
        self.line.tell(":WAV:FORM WORD;:WAV:BYT MSBF;:WAV:UNS 1;:WAV:POIN:MODE RAW")
        refuse_unlike("oscilloscope", self.held(), "look at the oscilloscope: probes, inputs, EXT")

    def held(self) -> list[Setting]:
        """What is to be set and what the instrument holds now; only asks."""
        return [self._setting(header, value) for header, value in self._wanted().items()]

    def close(self) -> None:
        """Hang up; it keeps its settings and puts nothing out."""
        self.line.close()

    def read(
        self, frequency_hz: float, voltage_v: float, alive: Callable[[], object] = nothing
    ) -> ElectrodeReading:
        """See `ElectrodeMonitor`. BadReply where no range shows the signal whole."""
        self.line.tell(f":TIM:RANG {PERIODS / frequency_hz:.9g}")
        record_s = self.line.numbers(":TIM:RANG?", 1)[0]
        guess_v = 2.4 * voltage_v * abs(complex(self.lines.response(frequency_hz)[0]))
        self._range_v[self._channels[0]] = min(max(guess_v, LEAST_RANGE_V), MOST_RANGE_V)
        for _ in range(ATTEMPTS):
            alive()
            self._set_ranges()
            self._acquire(record_s, alive)
            traces = [self._trace(n) for n in self._channels]
            if not self._rescaled([signal for signal, _, _ in traces]):
                return self._reading(traces, frequency_hz)
        raise BadReply(
            "oscilloscope: no range shows both monitors whole",
            "look at the channels; are the probes 1:1?",
        )

    def _wanted(self) -> dict[str, str]:
        """Headers and their values; the level comes after the source that it belongs to."""
        channels = {
            f":CHAN{n}:{name}": value for n in self._channels for name, value in _CHANNEL.items()
        }
        return channels | _ALL | {":TRIG:EDGE:LEV": f"{self._wiring.trigger_level_v:g}"}

    def _setting(self, header: str, value: str) -> Setting:
        """A level that is near enough counts as got."""
        answer = self.line.ask(f"{header}?")
        try:
            got, wanted = float(answer), float(value)
        except ValueError:
            return Setting(header, value, answer.upper())
        step = LEVEL_STEP_V if header.endswith("LEV") else 0.0
        return Setting(header, value, value if abs(got - wanted) <= step else f"{got:g}")

    def _set_ranges(self) -> None:
        """Full scales go out; what the channels make of them counts."""
        self.line.tell(*(f":CHAN{n}:RANG {self._range_v[n]:.6g}" for n in self._channels))
        for n in self._channels:
            self._range_v[n] = self.line.numbers(f":CHAN{n}:RANG?", 1)[0]

    def _acquire(self, record_s: float, alive: Callable[[], object]) -> None:
        """One record after one trigger; DeviceTimeout names the trigger where none came."""
        patience_s = self._wiring.reply_timeout_s + 2.0 * record_s
        deadline_s = self._clock() + patience_s
        triggered = False
        try:
            self.line.tell("*CLS", ":SING")  # *CLS empties the register of triggers too
            while True:
                triggered |= self.line.numbers(":TER?", 1)[0] == 1.0
                running = int(self.line.numbers(":OPER:COND?", 1)[0]) & _RUNNING
                if triggered and not running:
                    return
                if self._clock() > deadline_s:
                    break
                alive()
                self._sleep(POLL_S)
        except DeviceTimeout as error:
            self._give_up(patience_s, triggered, error)
        self._give_up(patience_s, triggered, None)

    def _give_up(self, patience_s: float, triggered: bool, why: DeviceTimeout | None) -> NoReturn:
        """Leave the oscilloscope so that it answers again, and say what did not come."""
        with suppress(DeviceError):
            if why is not None:
                self.line.clear()
            self.line.tell(":STOP", "*CLS")
        came = "a trigger came, the record did not end" if triggered else "no trigger came"
        raise DeviceTimeout(
            f"oscilloscope: {came} at EXT, {self._wiring.trigger_level_v:g} V rising, within"
            f" {patience_s:.3g} s",
            "wire the generator's Sync to EXT; is it on, and does it swing around trigger_level_v?",
        ) from why

    def _trace(self, channel: int) -> tuple[Array, float, float]:
        """A channel's record: signal in V [n], the sampling rate, and when its first sample was
        after the trigger.
        """
        self.line.tell(f":WAV:SOUR CHAN{channel}")
        _, _, _, _, dt_s, first_s, reference, step_v, zero_v, step_zero = self.line.numbers(
            ":WAV:PRE?", 10
        )
        raw = np.frombuffer(self.line.block(":WAV:DATA?"), dtype=">u2").astype(np.float64)
        if raw.size == 0 or not dt_s > 0.0:
            raise BadReply(
                f"oscilloscope: channel {channel} has no record",
                "is there a trigger on EXT, the Sync?",
            )
        return (raw - step_zero) * step_v + zero_v, 1.0 / dt_s, first_s - reference * dt_s

    def _rescaled(self, signals: Sequence[Array]) -> bool:
        """Whether a channel's range was wrong; the next is made for its peak."""
        changed = False
        for n, signal in zip(self._channels, signals, strict=True):
            used, range_v = 2.0 * float(np.max(np.abs(signal))) / self._range_v[n], self._range_v[n]
            if used > FULL and range_v >= MOST_RANGE_V:
                raise BadReply(
                    f"oscilloscope: channel {n} is beyond its largest range",
                    "are monitors and probes 1:1?",
                )
            wanted_v = (
                4.0 * range_v if used > FULL else used * range_v / 0.6 if used < FAINT else range_v
            )
            wanted_v = min(max(wanted_v, LEAST_RANGE_V), MOST_RANGE_V)
            changed |= wanted_v != range_v and not (used < FAINT and range_v <= LEAST_RANGE_V)
            self._range_v[n] = wanted_v
        return changed

    def _reading(
        self, traces: list[tuple[Array, float, float]], frequency_hz: float
    ) -> ElectrodeReading:
        """Both records against the generator's sine, as its Sync shows it.

        BadReply where the time base that it got shows no whole period.
        """
        (voltage, rate_hz, first_s), (current, _, _) = traces
        count = min(voltage.size, current.size)
        time_s = first_s + np.arange(count) / rate_hz
        generator = np.sin(2.0 * pi * frequency_hz * time_s)
        step_v = max(self._range_v.values()) / STEPS
        record = Record(
            np.column_stack([voltage[:count], current[:count], generator]), rate_hz, step_v
        )
        try:
            return electrode_reading(record, self.lines, frequency_hz)
        except ValueError as error:
            raise BadReply(f"oscilloscope: {error}", "is its time base fixed?") from error
