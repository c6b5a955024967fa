"""An analog output whose time passes in explicit steps, and that remembers what was at its terminal."""

from __future__ import annotations

import numpy as np

from hw.analog_output import AnalogOutput, AnalogOutputSettings, Array
from hw.errors import DeviceDisconnected


class SimulatedAnalogOutput(AnalogOutput):
    """Plays its stream as `advance` lets time pass; like a real card it keeps its last sample when it runs dry.

    Checks, leases and underruns are those of every analog output. `terminal_v` is what is at the terminal now,
    `played_v` every sample of streams so far, `broken` makes every access fail as an unplugged card does.
    """

    def __init__(self, settings: AnalogOutputSettings, resource: str = "simulated analog output") -> None:
        self._time_s = 0.0
        super().__init__(resource, settings, clock=lambda: self._time_s, watch=False)
        self.terminal_v = settings.zero_level_v
        self.played_v: list[float] = []
        self.broken = False
        self._waiting = np.empty(0)
        self._stream_rate_hz = 0.0
        self._owed_samples = 0.0

    def advance(self, dt_s: float) -> float:
        """Let time pass; return the level at the terminal at its end, V, after what was not refreshed went to zero."""
        with self._exclusive():
            self._time_s += dt_s
            self._owed_samples += dt_s * self._stream_rate_hz
            due = min(int(self._owed_samples + 1e-6), self._waiting.size)
            self._owed_samples -= due
            if due:
                self.played_v += self._waiting[:due].tolist()
                self.terminal_v = self.played_v[-1]
                self._waiting = self._waiting[due:]
            self._expire()
            return self.terminal_v

    def _connect(self) -> None:
        self._touch()

    def _disconnect(self) -> None:
        self._waiting, self._stream_rate_hz = np.empty(0), 0.0

    def _set_level(self, level_v: float) -> None:
        self._touch()
        self._waiting, self._stream_rate_hz, self.terminal_v = np.empty(0), 0.0, level_v

    def _start(self, block_v: Array, sample_rate_hz: float) -> None:
        self._touch()
        self._waiting, self._stream_rate_hz, self._owed_samples = block_v, sample_rate_hz, 0.0

    def _append(self, block_v: Array) -> None:
        self._touch()
        self._waiting = np.concatenate((self._waiting, block_v))

    def _buffered_samples(self) -> int:
        self._touch()
        return int(self._waiting.size)

    def _touch(self) -> None:
        if self.broken:
            raise DeviceDisconnected(f"{self.resource} does not answer", "mend it")
