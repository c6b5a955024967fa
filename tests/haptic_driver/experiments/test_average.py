"""Averaged friction: its standard error is that of repeated measurements."""

from __future__ import annotations

import math

import numpy as np
import pytest

from haptic_driver.experiments.average import average, mean_reading, standard_error
from hw.monitor.contract import ElectrodeReading


def remembering(kept: float, count: int, repeats: int) -> np.ndarray:
    random = np.random.default_rng(3)
    series = np.empty((repeats, count))
    series[:, 0] = random.standard_normal(repeats)
    for i in range(1, count):
        series[:, i] = kept * series[:, i - 1] + np.sqrt(1.0 - kept**2) * random.standard_normal(
            repeats
        )
    return series


# 600 repeats know a variance to 6 %; the estimator's own bias is below 5 %, or 10 % where the
# window is short.
@pytest.mark.parametrize(("kept", "tolerance"), [(0.0, 0.15), (0.6, 0.15), (0.9, 0.25)])
def test_the_standard_error_covers_the_scatter_of_means(kept: float, tolerance: float) -> None:
    series = remembering(kept, 200, 600)
    claimed = np.mean([standard_error(row) ** 2 for row in series])
    assert claimed == pytest.approx(np.var(series.mean(axis=1)), rel=tolerance)


def test_friction_is_the_ratio_of_mean_forces() -> None:
    normal = np.full(100, 0.5) + 0.01 * np.sin(np.arange(100))
    measured = average(np.linspace(2.0, 4.0, 100), 0.6 * normal, normal)
    assert measured.cof == pytest.approx(0.6)
    assert measured.cof_std == pytest.approx(0.0, abs=1e-12)
    assert measured.normal_force_n == pytest.approx(0.5, abs=0.001)
    assert measured.time_s == pytest.approx(3.0)


def test_nothing_measured_is_not_valid() -> None:
    time_s = np.arange(100.0)
    assert not average(time_s, np.zeros(100), np.full(100, 0.5)).valid
    assert not average(time_s, np.full(100, np.nan), np.full(100, 0.5)).valid


def readings(scatter: float, n: int, seed: int = 0) -> list[ElectrodeReading]:
    """Each with a stated error of 1e-7 A, scattering by as much or more."""
    rng = np.random.default_rng(seed)
    noise = scatter * (rng.standard_normal(n) + 1j * rng.standard_normal(n))
    return [ElectrodeReading(5.0, 0.01, 1e-4j + error, 1e-7, 1e-6, math.nan) for error in noise]


def test_readings_of_the_electrode_are_averaged_with_the_error_that_they_state() -> None:
    mean = mean_reading(readings(0.0, 4))
    assert mean is not None
    assert mean[:5] == pytest.approx((5.0, 0.005, 1e-4j, 5e-8, 1e-6))
    assert math.isnan(mean.third_a)
    assert mean_reading([]) is None


def test_what_scatters_more_than_it_states_is_less_certain() -> None:
    """The standard error of a mean of five parts with standard deviation 2e-6 each."""
    means = [mean_reading(readings(2e-6, 5, seed)) for seed in range(300)]
    stds = [mean.current_std_a for mean in means if mean is not None]
    assert np.sqrt(np.mean(np.square(stds))) == pytest.approx(2e-6 / np.sqrt(5), rel=0.05)
