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
from model.electric.charges import coefficients, constant_layers
from model.electric.dielectrics import EPS0

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


def test_a_stuck_finger_is_a_sliding_one_without_gap(models):
    """u -> 0 in the network of layers: the worst case of the current."""
    d = models["reference"].description
    f = 1e4
    layers, jw = constant_layers(d.values, d.dielectric, f), 2j * np.pi * f
    rho1, rho2 = coefficients(layers, 1e-15).response(jw)
    insulator, gap, skin = layers.elastances(1e-15)
    displacement = (1.0 + insulator * rho1 - skin * rho2) / (
        insulator + gap + skin
    )  # of the gap, (10)
    field = (
        V * (displacement - rho1) / layers.insulator_permittivity_f_per_m
    )  # of the insulator, (9)
    current = abs(
        (layers.insulator_conductivity_s_per_m + jw * layers.insulator_permittivity_f_per_m) * field
    )
    stuck = models["reference"].predict(at(f)).stuck_current_rms_a[0]
    assert stuck == pytest.approx(
        current * 1e-4 / np.sqrt(2.0), rel=1e-6
    )  # a gap of 1e-15 m beside 0.4 um


def test_a_thick_insulator_leaves_no_force(variant):
    """Far thicker than every gap, the field is V/(d1/eps1) and the force falls as its square."""
    forces = [
        variant(leak_scale=0.0, insulator_thickness_m=d).predict(at(250.0)).electrostatic_force_n[0]
        for d in (2.5e-4, 5e-4, 1e-3)
    ]
    assert forces[0] > forces[1] > forces[2] > 0.0
    field = V / (1e-3 / 3.9 + 44e-6)  # at the mean gap
    assert forces[2] == pytest.approx(1e-4 * EPS0 / 4.0 * field**2, rel=0.1)


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
