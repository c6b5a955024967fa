from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hw.finger.plant import FingerPlant


def friction(
    frequency_hz: float, voltage_v: float, normal_force_n: float, speed_m_s: float
) -> float:
    """0.4 N/N, and 1 N more at 100 V."""
    return 0.4 * normal_force_n + (voltage_v / 100.0) ** 2


def test_the_step_response_is_the_closed_form():
    plant = FingerPlant(friction)
    plant.step(1e-3, 250.0, 0.0, 0.5, 0.020)
    time_s = 0.0
    for _ in range(50):
        force_n = plant.step(1e-4, 250.0, 100.0, 0.5, 0.020)
        time_s += 1e-4
        # 13.8 Hz per mm/s at 20 mm/s: 276 Hz
        assert force_n == pytest.approx(
            0.2 + 1.0 - math.exp(-2.0 * math.pi * 276.0 * time_s), rel=1e-9
        )


@given(
    st.lists(st.floats(1e-6, 1e-2), min_size=1, max_size=20),
    st.floats(0.0, 0.2),
    st.floats(0.0, 200.0),
)
def test_the_result_does_not_depend_on_the_step(steps_s, speed_m_s, voltage_v):
    fine, coarse = FingerPlant(friction), FingerPlant(friction)
    for dt_s in steps_s:
        fine.step(dt_s, 250.0, voltage_v, 0.5, speed_m_s)
    coarse.step(math.fsum(steps_s), 250.0, voltage_v, 0.5, speed_m_s)
    assert fine.lateral_force_n == pytest.approx(coarse.lateral_force_n, rel=1e-9)


def test_friction_is_frozen_at_zero_speed():
    plant = FingerPlant(friction)
    plant.step(1e-3, 250.0, 0.0, 0.5, 0.02)
    assert plant.step(10.0, 250.0, 100.0, 0.5, 0.0) == pytest.approx(0.2)


def test_sliding_either_way_is_the_same():
    there, back = FingerPlant(friction), FingerPlant(friction)
    assert there.step(1e-3, 250.0, 100.0, 0.5, 0.02) == back.step(1e-3, 250.0, 100.0, 0.5, -0.02)


@pytest.mark.parametrize("normal_force_n", [0.0, -0.1])
def test_no_contact_no_force_and_each_contact_starts_without_voltage(normal_force_n):
    plant = FingerPlant(friction)
    plant.step(1.0, 250.0, 100.0, 0.5, 0.02)
    assert plant.lateral_force_n == pytest.approx(1.2)
    assert plant.step(1e-3, 250.0, 100.0, normal_force_n, 0.02) == 0.0
    assert plant.normal_force_n == 0.0
    # 0.4 * 1 N, and the first part of the rise towards 1.4 N: 1 - exp(-2 pi 276 Hz 0.1 ms) =
    # 0.159258...
    assert plant.step(1e-4, 250.0, 100.0, 1.0, 0.02) == pytest.approx(0.4 + 0.15925, abs=1e-4)


def test_each_contact_is_known_by_when_it_began():
    plant = FingerPlant(friction)
    plant.step(5.0, 250.0, 100.0, 0.0, 0.02)
    plant.step(1.0, 250.0, 100.0, 0.5, 0.02)
    plant.step(1.0, 250.0, 100.0, 0.5, 0.02)
    assert (plant.time_s, plant.touched_s) == (7.0, 5.0)
    plant.step(1.0, 250.0, 100.0, 0.0, 0.02)
    plant.step(1.0, 250.0, 100.0, 0.5, 0.02)
    assert plant.touched_s == 8.0
