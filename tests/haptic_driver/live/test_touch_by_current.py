"""Friction from current on an independent finger, which shares no code with the model."""

from __future__ import annotations

import numpy as np
import pytest

from haptic_driver.live.touch_by_current import TouchByCurrent
from haptic_driver.lookup.models import load_model
from hw.monitor.contract import ElectrodeReading
from model.conditions import Conditions
from model.touch_model import TouchModel
from tests.blind.generator.effects_electric import skin_hydration
from tests.blind.generator.electrode import touch_admittance
from tests.blind.generator.nuisance import ROUGHNESS
from tests.blind.generator.touch import Finger, Rows, friction, prepare

READ_EVERY_S, COUNT, CARRIER_HZ = 0.02, 200, 200.0
MOIST = Finger(h_rms=22e-6, skin=170e-6, leak=1.3, gap_offset=0.05e-6)
USUAL_N = 0.5


def drawn() -> Rows:
    """A texture's voltages under a load that changes."""
    time_s = READ_EVERY_S * np.arange(COUNT)
    voltage_v = 85.0 + 35.0 * np.sin(2.0 * np.pi * time_s / 0.13)
    load_n = USUAL_N * np.exp(0.35 * np.sin(2.0 * np.pi * time_s / 7.0))
    return Rows(np.full(COUNT, CARRIER_HZ), voltage_v, load_n, np.full(COUNT, 0.02), time_s)


@pytest.mark.parametrize("wetness", [0.0, 1.2])
def test_friction_from_current_of_an_independent_finger_is_nearer_than_the_models(wetness):
    rows = drawn()
    state = prepare(rows, MOIST, ROUGHNESS)
    skin_hydration(state, wetness, {"fall": 1.0}, True)
    cof, current_a = friction(state), touch_admittance(state) * rows.v
    current_a = current_a * (
        1.0 + 0.01 * np.random.default_rng(3).standard_normal((COUNT, 2)) @ [1.0, 1j]
    )
    description = load_model("reference")
    touch = TouchByCurrent(description, USUAL_N)
    felt = [
        touch.felt(
            CARRIER_HZ, ElectrodeReading(complex(v), 0.0, complex(i), 0.01 * abs(i)), READ_EVERY_S
        )
        for v, i in zip(rows.v, current_a, strict=True)
    ]
    found = np.array([each.cof for each in felt])
    fixed = TouchModel(description).predict(Conditions(rows.f, rows.v, np.full(COUNT, USUAL_N))).cof
    settled = slice(COUNT // 2, None)
    off, fixed_off = (
        np.sqrt(np.mean((each[settled] / cof[settled] - 1.0) ** 2)) for each in (found, fixed)
    )
    assert found.size == COUNT
    assert off < 0.6 * fixed_off


def test_without_a_voltage_the_current_says_nothing_and_what_was_known_is_forgotten():
    touch = TouchByCurrent(load_model("reference"), USUAL_N)
    quiet = ElectrodeReading(0.5 + 0.0j, 0.01, 1e-7j, 1e-8)
    driven = ElectrodeReading(80.0 + 0.0j, 0.0, 6e-5 + 9e-5j, 1e-6)
    first = touch.felt(CARRIER_HZ, driven, READ_EVERY_S)
    for _ in range(20):
        touch.felt(CARRIER_HZ, driven, READ_EVERY_S)
    felt = touch.felt(CARRIER_HZ, quiet, 1e4)
    assert felt[:2] == pytest.approx((USUAL_N, 0.512), rel=1e-3)
    assert not felt.tells
    assert touch.felt(CARRIER_HZ, driven, READ_EVERY_S) == pytest.approx(first, rel=1e-6)
