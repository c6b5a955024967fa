"""A simulated card in this process, for tests of what uses an analog output."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hw.analog.output import AnalogOutput, AnalogOutputSettings
from hw.analog.simulated_output import SimulatedCard
from hw.errors import DeviceDisconnected

Array = NDArray[np.float64]


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
