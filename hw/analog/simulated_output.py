"""A card's analog output whose time passes in explicit steps, and the same behind the driver's checks."""

from __future__ import annotations

import threading

import numpy as np

from hw.analog.output import AnalogOutput, AnalogOutputSettings, Array
from hw.errors import DeviceDisconnected


class SimulatedCard:
    """Plays its stream as `advance` lets time pass; like a real card it keeps its last sample when it runs dry.

    `terminal_v` is what is at the terminal now. Thread-safe.
    """

    def __init__(self, level_v: float) -> None:
        self.terminal_v = level_v
        self._waiting = np.empty(0)
        self._rate_hz = 0.0
        self._owed_samples = 0.0
        self._lock = threading.Lock()

    @property
    def waiting(self) -> int:
        """Samples still to be played."""
        return int(self._waiting.size)

    def set_level(self, level_v: float) -> None:
        """Put out a constant level now; what is waiting is dropped."""
        with self._lock:
            self._waiting, self._rate_hz, self.terminal_v = np.empty(0), 0.0, level_v

    def start(self, block_v: Array, sample_rate_hz: float) -> None:
        """Begin a stream."""
        with self._lock:
            self._waiting, self._rate_hz, self._owed_samples = block_v, sample_rate_hz, 0.0

    def append(self, block_v: Array) -> None:
        """Add to it."""
        with self._lock:
            self._waiting = np.concatenate((self._waiting, block_v))

    def advance(self, dt_s: float) -> Array:
        """Let time pass; return the samples of the stream that were played."""
        with self._lock:
            self._owed_samples += dt_s * self._rate_hz
            due = min(int(self._owed_samples + 1e-6), self._waiting.size)
            dry = due == self._waiting.size
            self._owed_samples = 0.0 if dry else self._owed_samples - due
            played_v, self._waiting = self._waiting[:due], self._waiting[due:]
            if due:
                self.terminal_v = float(played_v[-1])
            return played_v


class SimulatedAnalogOutput(AnalogOutput):
    """A card in this process, with the checks, leases and underruns of every analog output; `advance` lets time pass.

    `terminal_v` is what is at the terminal now, `played_v` every sample of streams so far, `broken` makes every access
    fail as an unplugged card does.
    """

    def __init__(self, settings: AnalogOutputSettings, resource: str = "simulated analog output") -> None:
        self._time_s = 0.0
        super().__init__(resource, settings, clock=lambda: self._time_s, watch=False)
        self.played_v: list[float] = []
        self.broken = False
        self._card = SimulatedCard(settings.zero_level_v)

    @property
    def terminal_v(self) -> float:
        """What is at the terminal now."""
        return self._card.terminal_v

    def advance(self, dt_s: float) -> float:
        """Let time pass; return the level at the terminal at its end, V, after what was not refreshed went to zero."""
        with self._exclusive():
            self._time_s += dt_s
            self.played_v += self._card.advance(dt_s).tolist()
            self._expire()
            return self.terminal_v

    def _connect(self) -> None:
        self._reached()

    def _disconnect(self) -> None:
        pass

    def _set_level(self, level_v: float) -> None:
        self._reached().set_level(level_v)

    def _start(self, block_v: Array, sample_rate_hz: float) -> None:
        self._reached().start(block_v, sample_rate_hz)

    def _append(self, block_v: Array) -> None:
        self._reached().append(block_v)

    def _buffered_samples(self) -> int:
        return self._reached().waiting

    def _reached(self) -> SimulatedCard:
        if self.broken:
            raise DeviceDisconnected(f"{self.resource} does not answer", "mend it")
        return self._card
