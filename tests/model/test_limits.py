"""Limits that the physics must reach and that no other file holds: currents, thick layers, closed
and open gaps.

Beside them: no leak and infinite leak, direct current, high frequency (test_touch_model,
test_layers, test_charges); light and complete contact (test_contact, test_gap_table); friction at
the divergence (test_friction).
"""

from __future__ import annotations

import numpy as np
import pytest

from model.conditions import Conditions
from model.contact.gap_distribution import gap_distribution
from model.contact.gap_table import gap_mass, integrals_of

V, LOAD_N = 75.0, 0.5


def at(frequency_hz, voltage_v=V, normal_force_n=LOAD_N) -> Conditions:
    columns = (
        np.atleast_1d(np.asarray(x, float)) for x in (frequency_hz, voltage_v, normal_force_n)
    )
    return Conditions(*(np.array(c) for c in np.broadcast_arrays(*columns)))


def test_largest_current_of_a_stuck_finger(models):
    """914 mA at 1 MHz, 75 V, 1 cm2; below, the skin conducts and the current is not in proportion
    to f.
    """
    stuck = np.sqrt(2.0) * models["reference"].predict(at([250.0, 1e4, 1e6])).stuck_current_rms_a
    assert stuck[2] == pytest.approx(
        0.914, rel=2e-2
    )  # "about": it leaves out the loss of the skin, 0.24 of eps
    assert (stuck[:2] > stuck[2] * np.array([250.0, 1e4]) / 1e6).all()


def test_wide_gaps_are_a_plate_capacitor(models, scales_of):
    """A stack far thicker than the roughness sees the mean gap only: K -> 1/z^2."""
    model = models["reference"]
    z = 1e3 * np.ones(1, complex)  # in h_rms
    k_hat, _ = integrals_of(gap_mass(model.table.shape, 5e3 / scales_of(model).pressure_pa), z)
    gap = gap_distribution(model.table.shape, 5e3 / scales_of(model).pressure_pa)
    expected = (1.0 - gap.area_ratio) / (1e3 + gap.mean_gap) ** 2
    assert k_hat[0] == pytest.approx(
        expected, rel=3e-4
    )  # mass 2e-4, mean 1 % of 2e-3, spread (1/1e3)^2
