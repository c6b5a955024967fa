"""A force sensor with noise and an end of range."""

from __future__ import annotations

import random
from typing import Protocol

from hw.force.sensor import ForceReading


class ForceSource(Protocol):
    """What a simulated sensor feels, e.g. a `FingerPlant`."""

    @property
    def time_s(self) -> float:
        """Simulated time."""

    @property
    def normal_force_n(self) -> float:
        """Force pressing on the screen."""

    @property
    def lateral_force_n(self) -> float:
        """Force along the sliding direction."""


class SimulatedForceSensor:
    """Reads a plant with Gaussian noise of standard deviation `noise_n` on each channel.

    Readings end at +-`range_n` and are then marked saturated. The same seed gives the same noise.
    """

    def __init__(self, plant: ForceSource, *, noise_n: float, range_n: float, seed: int) -> None:
        self._plant = plant
        self._noise_n = noise_n
        self._range_n = range_n
        self._random = random.Random(seed)

    def read(self) -> ForceReading:
        """Return the plant's forces now, as a real sensor would."""
        normal_n, normal_saturated = self._measure(self._plant.normal_force_n)
        lateral_n, lateral_saturated = self._measure(self._plant.lateral_force_n)
        return ForceReading(self._plant.time_s, normal_n, lateral_n, normal_saturated or lateral_saturated)

    def _measure(self, force_n: float) -> tuple[float, bool]:
        noisy_n = force_n + self._random.gauss(0.0, self._noise_n)
        return max(-self._range_n, min(noisy_n, self._range_n)), abs(noisy_n) >= self._range_n
