"""Readings of the electrode are averaged with the errors that they state, or scatter by."""

from __future__ import annotations

import math

import numpy as np
import pytest

from haptic_driver.lab.measuring.electrode import mean_reading
from hw.monitor.contract import ElectrodeReading


def readings(scatter: float, n: int, seed: int = 0) -> list[ElectrodeReading]:
    """Each with a stated error of 1e-7 A, scattering by as much or more."""
    rng = np.random.default_rng(seed)
    noise = scatter * (rng.standard_normal(n) + 1j * rng.standard_normal(n))
    return [ElectrodeReading(5.0, 0.01, 1e-4j + error, 1e-7, 1e-6, math.nan) for error in noise]


def test_readings_of_the_electrode_are_averaged_with_the_error_that_they_state():
    mean = mean_reading(readings(0.0, 4))
    assert mean is not None
    assert mean[:5] == pytest.approx((5.0, 0.005, 1e-4j, 5e-8, 1e-6))
    assert math.isnan(mean.third_a)
    assert mean_reading([]) is None


def test_what_scatters_more_than_it_states_is_less_certain():
    """The standard error of a mean of five parts with standard deviation 2e-6 each."""
    means = [mean_reading(readings(2e-6, 5, seed)) for seed in range(300)]
    stds = [mean.current_std_a for mean in means if mean is not None]
    assert np.sqrt(np.mean(np.square(stds))) == pytest.approx(2e-6 / np.sqrt(5), rel=0.05)
