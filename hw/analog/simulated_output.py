"""The analog output of a simulated card: a buffer in memory that plays by the clock alone.

It plays without a running process, as a real card does. What was written and the time determine the
value at the terminal. Whoever simulates the rest of the rig, in this process or in another, looks
at the memory.
"""

from __future__ import annotations

import mmap
import os
import struct
import time
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from hw.analog.output import AnalogOutput, AnalogOutputSettings, Array, CardReserved
from hw.errors import DeviceDisconnected
from hw.setting import Setting, refuse_unlike

BUFFER_SAMPLES = 1 << 14
READ_BACK = 1000  # samples: a period of every carrier
TIMEBASE_HZ = 20e6  # of which a sample takes a whole number of ticks
_SAMPLE = np.dtype("<f8")
_ATTEMPTS = 100  # at a header that a writer keeps changing


class _Told(NamedTuple):
    """The card's last order: samples from `start_s` on where `rate_hz` is not 0, else a level."""

    rate_hz: float
    start_s: float
    level_v: float
    written: int


class CardMemory:
    """The card itself: one writer, the driver's end; any number of readers, who see what the
    terminal has.

    The driver's end is reserved for one program, as NI-DAQmx does it, until that lets go or ends.
    Sample k of a stream is at the terminal from k sample periods after its start on. A stream that
    has run dry stays at its last sample, as a real card's does. Without `memory` the card is of
    this process alone.
    """

    _HEADER = struct.Struct("=dddQ")
    SIZE = 64 + BUFFER_SAMPLES * _SAMPLE.itemsize

    def __init__(self, memory: memoryview | None = None) -> None:
        whole = memoryview(bytearray(self.SIZE)) if memory is None else memory
        self._sequence = whole[:8].cast("Q")
        self._header = whole[8 : 8 + self._HEADER.size]
        self._samples = np.frombuffer(whole[64:], _SAMPLE, BUFFER_SAMPLES)
        self._told = _Told(*self._HEADER.unpack(self._header))
        self._mine: _Told | None = None  # this end's last order
        self._path: str | None = None  # where others find it; None: of this process alone
        self._reserved: int | None = None

    @classmethod
    def create(cls) -> tuple[CardMemory, int]:
        """A card in memory without a name, and the descriptor by which others reach it."""
        descriptor = os.memfd_create("simulated-card", os.MFD_CLOEXEC)
        os.ftruncate(descriptor, cls.SIZE)
        return cls(memoryview(mmap.mmap(descriptor, cls.SIZE))), descriptor

    @classmethod
    def at(cls, path: str) -> CardMemory:
        """The card of another process, at `/proc/PID/fd/N`. Raises DeviceDisconnected."""
        try:
            descriptor = os.open(path, os.O_RDWR | os.O_CLOEXEC)
        except OSError as error:
            raise DeviceDisconnected(
                f"the simulated card is gone ({error})", "restart the simulation"
            ) from error
        try:
            found = cls(memoryview(mmap.mmap(descriptor, cls.SIZE)))
        finally:
            os.close(descriptor)
        found._path = path
        return found

    # --- the driver's end --------------------------------------------------------------------

    def reserve(self) -> None:
        """Keep other programs from it; CardReserved where one has it, even one that hangs."""
        if self._path is None or self._reserved is not None:
            return
        import fcntl  # noqa: PLC0415 - Linux has it

        descriptor = os.open(self._path, os.O_RDWR | os.O_CLOEXEC)
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            os.close(descriptor)
            raise CardReserved(
                "the simulated card is used by another program", "end it; or reset the card"
            ) from error
        self._reserved = descriptor

    def release(self) -> None:
        """Let others have it."""
        if self._reserved is not None:
            os.close(self._reserved)
            self._reserved = None

    def set_level(self, level_v: float) -> None:
        """Put out a constant level; what is waiting is dropped."""
        self._tell(_Told(0.0, 0.0, level_v, 0))

    def start(self, block_v: Array, sample_rate_hz: float, at_s: float) -> None:
        """Begin a stream at a time."""
        self._samples[np.arange(block_v.size) % BUFFER_SAMPLES] = block_v
        self._tell(_Told(sample_rate_hz, at_s, 0.0, block_v.size))

    def append(self, block_v: Array) -> None:
        """Add to the stream. DeviceDisconnected where somebody else has taken the card since."""
        self._check_mine()
        written = self._told.written
        self._samples[np.arange(written, written + block_v.size) % BUFFER_SAMPLES] = block_v
        self._tell(self._told._replace(written=written + block_v.size))

    # --- the terminal ------------------------------------------------------------------------

    def waiting(self, at_s: float) -> int:
        """How many samples of this end's stream are still to be played then. DeviceDisconnected
        where another end has written to the card since.
        """
        self._check_mine()
        told = self._newest()
        return max(told.written - self._place(told, at_s), 0) if told.rate_hz else 0

    def terminal_v(self, from_s: float, to_s: float) -> float:
        """The mean level at the terminal between two times, V; at the first one where both are the
        same.
        """
        told = self._newest()
        if not told.rate_hz:
            return told.level_v
        last = told.written - 1
        begin = min(self._place(told, from_s), last)
        end = min(max(self._place(told, to_s), begin + 1), last + 1)
        return float(self._samples[np.arange(begin, end) % BUFFER_SAMPLES].mean())

    def recent(self, to_s: float, count: int) -> tuple[Array, float]:
        """The newest samples that were at the terminal until then, and their rate; of a level one
        sample.
        """
        told = self._newest()
        if not told.rate_hz:
            return np.array([told.level_v]), 0.0
        place = self._place(told, to_s)
        first = max(place - count + 1, 0)
        taken = np.minimum(np.arange(first, place + 1), told.written - 1)
        return np.asarray(self._samples[taken % BUFFER_SAMPLES]), told.rate_hz

    @staticmethod
    def _place(told: _Told, at_s: float) -> int:
        """The sample that is at the terminal then; rounding of the times counts for nothing."""
        return max(int((at_s - told.start_s) * told.rate_hz + 1e-6), 0)

    def _check_mine(self) -> None:
        if self._mine is not None and self._newest() != self._mine:
            raise DeviceDisconnected("the simulated card was taken by another", "connect it again")

    def _tell(self, told: _Told) -> None:
        self._told = self._mine = told
        self._sequence[0] |= 1  # a reader looks again
        self._header[:] = self._HEADER.pack(*told)
        self._sequence[0] += 1

    def _newest(self) -> _Told:
        """The card's last complete order: a writer killed halfway leaves the earlier one."""
        for _ in range(_ATTEMPTS):
            before = self._sequence[0]
            told = _Told(*self._HEADER.unpack(self._header))
            if not before & 1 and self._sequence[0] == before:
                self._told = told
                break
        return self._told


class SimulatedAnalogOutput(AnalogOutput):
    """The driver's end of a simulated card, with the checks of every analog output."""

    def __init__(
        self,
        card: Callable[[], CardMemory],
        settings: AnalogOutputSettings,
        *,
        clock: Callable[[], float] = time.monotonic,
        watch: bool = True,
    ) -> None:
        super().__init__("simulated analog output", settings, clock=clock, watch=watch)
        self._find = card
        self._card: CardMemory | None = None

    def _connect(self) -> None:
        card = self._find()
        card.reserve()
        self._card = card

    def _disconnect(self) -> None:
        if self._card is not None:
            self._card.release()
        self._card = None

    def reset(self) -> None:
        """Whoever has it is told so with the next order."""
        self._find().set_level(0.0)

    def read_back_v(self) -> float | None:
        """The highest of the last samples at the terminal."""
        card = self._card or self._find()
        return float(np.abs(card.recent(self._clock(), READ_BACK)[0]).max())

    def _set_level(self, level_v: float) -> None:
        self._connected().set_level(level_v)

    def _start(self, block_v: Array, sample_rate_hz: float) -> None:
        got = Setting("sample_rate_hz", sample_rate_hz, self._rate_got_hz(sample_rate_hz))
        refuse_unlike(self.resource, [got], "write at the rate of `plays_at`")
        self._connected().start(block_v, sample_rate_hz, self._clock())

    def _rate_got_hz(self, sample_rate_hz: float) -> float:
        return TIMEBASE_HZ / round(TIMEBASE_HZ / sample_rate_hz)

    def _append(self, block_v: Array) -> None:
        self._connected().append(block_v)

    def _buffered_samples(self) -> int:
        return self._connected().waiting(self._clock())

    def _connected(self) -> CardMemory:
        if self._card is None:
            raise DeviceDisconnected(f"{self.resource} is not open", "call open() first")
        return self._card


def make_output(where: str, settings: AnalogOutputSettings) -> AnalogOutput:
    """`card:simulated:/proc/PID/fd/N`."""
    return SimulatedAnalogOutput(lambda: CardMemory.at(where), settings)
