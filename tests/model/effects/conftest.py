"""Effects at their medians, and touches of every kind."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from model.conditions import Conditions
from model.effects import Effect


@pytest.fixture(scope="session")
def median():
    """An effect at its prior medians, moved by `x` standard deviations."""

    def make(effect: type[Effect], x: float = 0.0) -> Effect:
        return effect(**{p.name: float(p.from_normal(x)) for p in effect.parameters()})

    return make


def columns(n: int, seed: int) -> dict[str, Any]:
    rng = np.random.default_rng(seed)
    waveform = np.array(["sine", "square", "dc"])[np.arange(n) % 3]
    voltage = np.where(np.arange(n) % 5 == 4, 0.0, rng.uniform(1.0, 100.0, n))
    return {
        "frequency_hz": 10.0 ** rng.uniform(-1.0, 6.0, n),
        "voltage_v": voltage,
        "normal_force_n": 10.0 ** rng.uniform(-1.3, 0.3, n),
        "waveform": waveform,
        "speed_m_s": 10.0 ** rng.uniform(-3.0, -0.7, n),
        "time_s": rng.uniform(0.0, 600.0, n),
    }


@pytest.fixture(scope="session")
def unbiased():
    """Sines, square waves and direct voltages, some of them of 0 V; speeds, times."""
    return Conditions(**columns(45, 1))


@pytest.fixture(scope="session")
def biased():
    """The same kinds, most of them with a bias of either sign."""
    offset = np.where(
        np.arange(45) % 4 == 3, 0.0, np.random.default_rng(3).uniform(-60.0, 60.0, 45)
    )
    return Conditions(**columns(45, 2), voltage_offset_v=offset)
