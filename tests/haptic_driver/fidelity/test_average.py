"""Averaged friction: its standard error is that of repeated measurements."""

from __future__ import annotations

import numpy as np
import pytest

from haptic_driver.fidelity.average import average, standard_error


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
def test_the_standard_error_covers_the_scatter_of_means(kept, tolerance):
    series = remembering(kept, 200, 600)
    claimed = np.mean([standard_error(row) ** 2 for row in series])
    assert claimed == pytest.approx(np.var(series.mean(axis=1)), rel=tolerance)


def test_friction_is_the_ratio_of_mean_forces():
    normal = np.full(100, 0.5) + 0.01 * np.sin(np.arange(100))
    measured = average(np.linspace(2.0, 4.0, 100), 0.6 * normal, normal)
    assert measured.cof == pytest.approx(0.6)
    assert measured.cof_std == pytest.approx(0.0, abs=1e-12)
    assert measured.normal_force_n == pytest.approx(0.5, abs=0.001)
    assert measured.time_s == pytest.approx(3.0)


def test_nothing_measured_is_not_valid():
    time_s = np.arange(100.0)
    assert not average(time_s, np.zeros(100), np.full(100, 0.5)).valid
    assert not average(time_s, np.full(100, np.nan), np.full(100, 0.5)).valid
