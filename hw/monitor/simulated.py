"""Simulated monitor lines: what an amplifier's outputs show of an electrode, with their bandwidth
and their noise.
"""

from __future__ import annotations

from collections.abc import Callable
from math import floor, pi
from typing import NamedTuple

import numpy as np

from hw.analog.output import Array
from hw.monitor.lines import MonitorLines

TIMEBASE_HZ = 100e6  # of which a sample takes a whole number of ticks


class ElectrodeState(NamedTuple):
    """What is at the electrode: peak phasors against the generator's output, and what is direct."""

    frequency_hz: float
    voltage_v: complex
    current_a: complex
    second_a: complex = 0.0
    third_a: complex = 0.0
    direct_v: float = 0.0


class SimulatedLines:
    """Both monitor lines and the generator's output as signals; `noise_v` is their standard
    deviation per sample.

    The generator runs on its own: every look at it finds another phase.
    """

    def __init__(
        self,
        state: Callable[[], ElectrodeState | None],
        lines: MonitorLines,
        noise_v: tuple[float, float],
        seed: int,
    ) -> None:
        self._state, self._lines, self._noise_v = state, lines, noise_v
        self._random = np.random.default_rng(seed)

    def signals_v(self, time_s: Array, start_phase_rad: float | None = None) -> Array:
        """Voltage monitor, current monitor, generator (1 V) at times [n] -> [n, 3], V."""
        state = self._state() or ElectrodeState(0.0, 0.0, 0.0)
        start = self._random.uniform(0.0, 2.0 * pi) if start_phase_rad is None else start_phase_rad
        turns = np.exp(1j * (2.0 * pi * state.frequency_hz * time_s + start))
        orders = ((state.voltage_v, state.current_a), (0.0, state.second_a), (0.0, state.third_a))
        signals = np.zeros((time_s.size, 3))
        for k, phasors in enumerate(orders, start=1):
            shown = np.array(phasors) * self._lines.response(k * state.frequency_hz)
            signals[:, :2] += np.real(shown * turns[:, None] ** k)
        signals[:, 0] += state.direct_v * self._lines.voltage_v_per_v
        signals[:, :2] += self._random.standard_normal((time_s.size, 2)) * self._noise_v
        signals[:, 2] = np.real(turns)
        return signals


class SimulatedInputs:
    """A card that samples the lines: clips at its range, rounds to its step, divides its time base.

    Of a rate that its time base does not divide it makes the next higher one, as NI's cards do.
    """

    lags_s = (0.0, 0.0, 0.0)

    def __init__(
        self,
        lines: SimulatedLines,
        sample_rate_hz: float,
        range_v: float,
        resolution_v: float,
        buffer_s: float = 2.0,
    ) -> None:
        self.sample_rate_hz = TIMEBASE_HZ / floor(TIMEBASE_HZ / sample_rate_hz * (1.0 + 1e-9))
        self.buffer_s = buffer_s
        self._lines = lines
        self._range_v, self._resolution_v = range_v, resolution_v

    def latest_v(self, count: int) -> Array:
        signals = self._lines.signals_v(np.arange(count) / self.sample_rate_hz)
        return np.asarray(
            np.clip(
                np.round(signals / self._resolution_v) * self._resolution_v,
                -self._range_v,
                self._range_v,
            )
        )
