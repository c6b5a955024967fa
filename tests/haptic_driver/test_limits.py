"""Limits over arrays, by hand; that the last gate agrees with them is in
`render/test_safety.py`.
"""

import math
from dataclasses import replace

import numpy as np
import pytest

from haptic_driver.limits import OperatingLimits

ROUNDING = 1e-12
PLAIN = OperatingLimits(voltage_v=150.0, frequency_low_hz=10.0, frequency_high_hz=1e6)


def test_highest_voltage_is_the_contact_limit_over_the_worst_case_current():
    # 0.5 mA at 1 kHz, 2 mA at 10 kHz, 20 mA at 100 kHz; the first allows more than the rig's 150 V
    found = PLAIN.highest_voltage_v(
        np.array([1e3, 1e3, 10e3, 100e3]), np.array([1e-6, 1e-5, 1e-4, 1e-3])
    )
    np.testing.assert_allclose(found, [150.0, 50.0, 20.0, 20.0], rtol=ROUNDING)


@pytest.mark.parametrize(
    ("changed", "frequency_hz", "expected_v"),
    [
        ({"series_resistance_ohm": 100e3}, 1e3, math.sqrt(2.0) * 0.5e-3 * 100e3),
        ({"series_resistance_ohm": 1e3}, 1e3, math.sqrt(2.0) * 0.5),
        (
            {"series_resistance_ohm": 500.0},
            1e3,
            0.5,
        ),  # less than what the finger itself allows: 0.5 mA over 1 mA/V
        (
            {"amplifier_current_a": 0.7e-3},
            1e3,
            150.0,
        ),  # cannot deliver 0.5 mA rms: no finger limit at all
        ({"amplifier_current_a": 0.8e-3}, 1e3, 0.5),
        ({"slew_v_per_s": 1e3}, 1e3, 1.0 / (2.0 * math.pi)),
        ({"amplifier_current_a": 0.7e-3, "panel_capacitance_f": 1e-6}, 1e3, 0.7 / (2.0 * math.pi)),
    ],
)
def test_what_bounds_the_voltage_for_a_worst_case_of_1_ma_per_volt(
    changed, frequency_hz, expected_v
):
    limits = OperatingLimits(150.0, 10.0, 1e6, **changed)
    assert limits.highest_voltage_v(frequency_hz, 1e-3) == pytest.approx(expected_v, rel=ROUNDING)


@pytest.mark.parametrize(
    ("touching_m2", "expected_v"),
    [(0.0, 50.0), (100e-6, 50.0), (471e-6, 50.0 / 4.71), (684e-6, 50.0 / 6.84)],
)
def test_a_hand_gets_what_one_finger_may_get(touching_m2, expected_v):
    """Stuck fingers of 684 mm2 once carried 6.84 times the limit at a voltage allowed for one of
    100 mm2: 0.5 mA over 10 uA/V.
    """
    limits = replace(PLAIN, touching_area_m2=touching_m2)
    stuck = limits.stuck_current(1e-5, 1e-5 / 100e-6)
    assert limits.highest_voltage_v(1e3, stuck) == pytest.approx(expected_v, rel=ROUNDING)


@pytest.mark.parametrize(
    ("touching_m2", "touches", "said"),
    [
        (0.0, 1, "one touch of 100 mm² alone"),
        (99e-6, 1, "one touch of 100 mm² alone"),
        (199e-6, 1, "199 mm² of contact in all"),
        (300e-6, 3, "300 mm² of contact in all"),
        (471e-6, 4, "471 mm² of contact in all"),
    ],
)
def test_as_many_touches_are_covered_as_fit(touching_m2, touches, said):
    limits = replace(PLAIN, touching_area_m2=touching_m2)
    assert limits.touches(100e-6) == touches
    assert limits.holds_for(100e-6) == said


def test_outside_the_band_no_voltage_is_allowed():
    np.testing.assert_array_equal(
        PLAIN.highest_voltage_v(np.array([9.99, 1.001e6]), 1e-9), [0.0, 0.0]
    )
    np.testing.assert_array_equal(
        PLAIN.highest_voltage_v(np.array([10.0, 1e6]), 1e-9), [150.0, 150.0]
    )


def test_a_current_of_zero_leaves_the_other_limits():
    assert PLAIN.highest_voltage_v(1e3, 0.0) == 150.0


def test_permits_broadcasts_over_frequency_and_voltage():
    found = PLAIN.permits(np.array([[1.0], [1e3]]), np.array([0.0, 100.0, 200.0]), 1e-6, 1e-6)
    np.testing.assert_array_equal(found, [[False, False, False], [True, True, False]])


@pytest.mark.parametrize("which", range(4))
def test_nan_is_never_permitted(which):
    values = [1e3, 100.0, 1e-4, 1e-4]
    assert bool(PLAIN.permits(*values))
    values[which] = math.nan
    assert not bool(PLAIN.permits(*values))
