"""A simulated card in this process, for tests of what uses an analog output; its time passes in
steps.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hw.analog.output import AnalogOutputSettings
from hw.analog.simulated_output import CardMemory, SimulatedAnalogOutput
from hw.errors import DeviceDisconnected

Array = NDArray[np.float64]


class SteppedAnalogOutput(SimulatedAnalogOutput):
    """An analog output that nobody watches; `advance` lets time pass.

    `terminal_v` is what is at the terminal now, `played_v` every sample of streams so far, `broken`
    makes every access fail as an unplugged card does.
    """

    def __init__(self, settings: AnalogOutputSettings) -> None:
        self.time_s = 0.0
        self.card = CardMemory()
        super().__init__(lambda: self.card, settings, clock=lambda: self.time_s, watch=False)
        self.played_v: list[float] = []
        self.broken = False

    @property
    def terminal_v(self) -> float:
        """What is at the terminal now."""
        return self.card.terminal_v(self.time_s, self.time_s)

    def advance(self, dt_s: float) -> float:
        """Let time pass; return the level at the terminal at its end, V, after what was not
        refreshed went to zero.
        """
        with self._exclusive():
            self.play(dt_s)
            self._expire()
            return self.terminal_v

    def play(self, dt_s: float) -> None:
        """Let time pass for the card alone."""
        told = self.card._told
        before = self.card.waiting(self.time_s)
        self.time_s += dt_s
        played = before - self.card.waiting(self.time_s) if told.rate_hz else 0
        first = told.written - before
        self.played_v += [
            float(v)
            for v in self.card._samples[np.arange(first, first + played) % self.card._samples.size]
        ]

    def _connected(self) -> CardMemory:
        if self.broken:
            raise DeviceDisconnected(f"{self.resource} does not answer", "mend it")
        return super()._connected()
