"""Regions certified by the half of the rows that did not show them."""

from dataclasses import dataclass

import numpy as np

from haptic_driver.lab.challenge.regions import certified
from model.diagnosis.data import Measurements, read_measurements

LEVELS_V = np.array([40.0, 60.0, 80.0, 100.0, 120.0])
LEVELS_HZ = np.array([20.0, 100.0, 500.0, 2500.0])


@dataclass
class Fitted:
    """Residuals of a fit, in standard deviations."""

    residual: np.ndarray


def table(tmp_path, repeats=5) -> Measurements:
    text = "frequency_hz,voltage_v,normal_force_n,cof,cof_std\n"
    for _ in range(repeats):
        for hz in LEVELS_HZ:
            text += "".join(f"{hz},{v},0.5,0.6,0.01\n" for v in LEVELS_V)
    path = tmp_path / "data.csv"
    path.write_text(text)
    return read_measurements(path)


def test_chance_alone_is_seldom_certified(tmp_path):
    """At most one region in twenty is false, so most data sets have none."""
    data, rng = table(tmp_path), np.random.default_rng(5)
    found = [bool(certified(data, Fitted(rng.standard_normal(data.count)))) for _ in range(100)]
    # 5 % on average; 12 of 100 or more have a chance of 0.4 %
    assert sum(found) < 12


def test_where_friction_is_off_is_certified(tmp_path):
    data, rng = table(tmp_path), np.random.default_rng(6)
    high = data.columns["voltage_v"] > 90.0
    first, *_ = certified(data, Fitted(rng.standard_normal(data.count) + 3.0 * high))
    low, end = first["voltage_v"]
    assert (low, end) == (100.0, 120.0)
