"""Keysight's InfiniiVision oscilloscopes (2000, 3000, 4000 and 6000 X-Series): two channels on the
monitor lines.

The external trigger is the generator's Sync, which rises where its sine does: time 0 of a record.
Commands are those of the series' Programmer's Guides; never tried on an instrument.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from math import pi

import numpy as np

from hw.analog.output import Array
from hw.errors import BadReply
from hw.monitor.contract import ElectrodeReading, nothing
from hw.monitor.lines import MonitorLines, Record, electrode_reading
from hw.monitor.scpi_line import ScpiLine
from hw.transport.contract import Transport

MODEL = re.compile(r"[DM]SO-?X ?\d{4}[A-Z]*")
PERIODS = 20  # of the carrier in a record
LEAST_RANGE_V, MOST_RANGE_V = 0.016, 40.0  # full scale of a channel
FULL, FAINT = 0.9, 0.2  # of the range: beyond it the signal may be cut, below it drowns in steps
ATTEMPTS = 6  # to find the range
STEPS = 2**12  # of the high-resolution acquisition


@dataclass(frozen=True)
class Oscilloscope:
    """How it is wired: channels of the voltage and the current monitor, and the carriers for which
    it is asked.
    """

    voltage_channel: int = 1
    current_channel: int = 2
    lowest_hz: float = 100.0
    highest_hz: float = 2e6
    reply_timeout_s: float = 2.0


class InfiniiVision:
    """Reads both monitor lines of an amplifier at once; each channel's range follows its signal."""

    drives = False

    def __init__(self, transport: Transport, wiring: Oscilloscope, lines: MonitorLines) -> None:
        self._line = ScpiLine(transport, wiring.reply_timeout_s)
        self._wiring, self._lines = wiring, lines
        self._channels = wiring.voltage_channel, wiring.current_channel
        self._range_v = dict.fromkeys(self._channels, 1.0)

    @property
    def frequency_range_hz(self) -> tuple[float, float]:
        """As the rig's file says."""
        return self._wiring.lowest_hz, self._wiring.highest_hz

    def open(self) -> None:
        """Connect and set up what does not change; raises DeviceError."""
        self._line.open(MODEL)
        channels = [f":CHAN{n}:DISP 1;:CHAN{n}:COUP DC;:CHAN{n}:OFFS 0" for n in self._channels]
        self._line.tell(
            "*RST",
            *channels,
            ":ACQ:TYPE HRES",
            ":TRIG:MODE EDGE;:TRIG:EDGE:SOUR EXT;:TRIG:EDGE:SLOP POS",
            ":TRIG:SWE NORM",
            ":WAV:FORM WORD;:WAV:BYT MSBF;:WAV:UNS 1;:WAV:POIN:MODE RAW",
            ":TIM:REF LEFT",
        )

    def close(self) -> None:
        """Hang up; it keeps its settings and puts nothing out."""
        self._line.close()

    def read(
        self, frequency_hz: float, voltage_v: float, alive: Callable[[], object] = nothing
    ) -> ElectrodeReading:
        """See `ElectrodeMonitor`. BadReply where no range shows the signal whole."""
        self._line.tell(f":TIM:RANG {PERIODS / frequency_hz:.9g}")
        guess_v = 2.4 * voltage_v * abs(complex(self._lines.response(frequency_hz)[0]))
        self._range_v[self._channels[0]] = min(max(guess_v, LEAST_RANGE_V), MOST_RANGE_V)
        for _ in range(ATTEMPTS):
            alive()
            self._line.tell(*(f":CHAN{n}:RANG {self._range_v[n]:.6g}" for n in self._channels))
            self._line.tell(f":DIG {','.join(f'CHAN{n}' for n in self._channels)}")
            self._line.numbers("*OPC?", 1)
            traces = [self._trace(n) for n in self._channels]
            if not self._rescaled([signal for signal, _, _ in traces]):
                return self._reading(traces, frequency_hz)
        raise BadReply(
            "oscilloscope: no range shows both monitors whole",
            "look at the channels; are the probes 1:1?",
        )

    def _trace(self, channel: int) -> tuple[Array, float, float]:
        """A channel's record: signal in V [n], the sampling rate, and when its first sample was
        after the trigger.
        """
        self._line.tell(f":WAV:SOUR CHAN{channel}")
        _, _, _, _, dt_s, first_s, reference, step_v, zero_v, step_zero = self._line.numbers(
            ":WAV:PRE?", 10
        )
        raw = np.frombuffer(self._line.block(":WAV:DATA?"), dtype=">u2").astype(np.float64)
        if raw.size == 0 or not dt_s > 0.0:
            raise BadReply(
                f"oscilloscope: channel {channel} has no record",
                "is there a trigger on EXT, the Sync?",
            )
        return (raw - step_zero) * step_v + zero_v, 1.0 / dt_s, first_s - reference * dt_s

    def _rescaled(self, signals: list[Array]) -> bool:
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
            changed |= wanted_v != range_v
            self._range_v[n] = wanted_v
        return changed

    def _reading(
        self, traces: list[tuple[Array, float, float]], frequency_hz: float
    ) -> ElectrodeReading:
        """Both records against the generator's sine, as its Sync shows it."""
        (voltage, rate_hz, first_s), (current, _, _) = traces
        count = min(voltage.size, current.size)
        time_s = first_s + np.arange(count) / rate_hz
        generator = np.sin(2.0 * pi * frequency_hz * time_s)
        step_v = max(self._range_v.values()) / STEPS
        record = Record(
            np.column_stack([voltage[:count], current[:count], generator]), rate_hz, step_v
        )
        return electrode_reading(record, self._lines, frequency_hz)
