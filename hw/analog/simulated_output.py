"""A card's analog output whose time passes in explicit steps, and the same behind the driver's checks."""

from __future__ import annotations

import threading

import numpy as np

from hw.analog.output import Array


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
