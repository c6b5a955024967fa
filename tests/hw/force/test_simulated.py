from __future__ import annotations

import statistics
from types import SimpleNamespace

import pytest

from hw.force.simulated import SimulatedForceSensor


def plant(normal_force_n: float = 0.5, lateral_force_n: float = -0.3) -> SimpleNamespace:
    return SimpleNamespace(time_s=1.25, normal_force_n=normal_force_n, lateral_force_n=lateral_force_n)


def test_without_noise_it_reads_the_plant() -> None:
    assert SimulatedForceSensor(plant(), noise_n=0.0, range_n=10.0, seed=1).read() == (1.25, 0.5, -0.3, False)


def test_the_noise_is_reproducible_and_of_the_stated_size() -> None:
    one, two = (SimulatedForceSensor(plant(), noise_n=0.01, range_n=10.0, seed=7) for _ in range(2))
    readings = [one.read() for _ in range(4000)]
    assert readings == [two.read() for _ in range(4000)]
    for channel, mean_n in ((1, 0.5), (2, -0.3)):
        values = [reading[channel] for reading in readings]
        assert statistics.mean(values) == pytest.approx(mean_n, abs=1e-3)  # 6 standard errors
        assert statistics.stdev(values) == pytest.approx(0.01, rel=0.1)  # 9 standard errors


@pytest.mark.parametrize(("normal_n", "lateral_n"), [(10.5, 0.0), (0.5, -11.0), (10.0, 0.0)])
def test_the_end_of_the_range_is_marked(normal_n: float, lateral_n: float) -> None:
    reading = SimulatedForceSensor(plant(normal_n, lateral_n), noise_n=0.0, range_n=10.0, seed=1).read()
    assert reading.saturated
    assert abs(reading.normal_force_n) <= 10.0
    assert abs(reading.lateral_force_n) <= 10.0
