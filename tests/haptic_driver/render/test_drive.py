"""The drive stage: a bounded rise, an immediate fall, and off for zero volts."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptic_driver.render.drive import INITIAL, DriveSettings, DriveState, drive
from haptic_driver.signals import DriveCommand, SafeOperatingPoint

SETTINGS = DriveSettings(voltage_rise_v_per_s=10e3)


def safe(voltage_v, frequency_hz=250.0):
    return SafeOperatingPoint(frequency_hz, voltage_v, None)


def test_voltage_rises_by_the_rate_times_the_time():
    state, command = drive(SETTINGS, DriveState(1.000, 0.0), safe(35.0), 1.001)
    assert command == DriveCommand(250.0, pytest.approx(10.0), True)  # 10 V per ms
    state, command = drive(SETTINGS, state, safe(35.0), 1.003)
    assert command.voltage_v == pytest.approx(30.0)
    state, command = drive(SETTINGS, state, safe(35.0), 1.004)
    assert command.voltage_v == 35.0
    assert state == DriveState(1.004, 35.0)


@pytest.mark.parametrize("time_s", [0.5, 1.0])
def test_a_clock_that_stands_or_goes_back_lets_nothing_rise(time_s):
    assert drive(SETTINGS, DriveState(1.0, 20.0), safe(100.0), time_s)[1].voltage_v == 20.0


def test_the_first_command_of_all_rises_like_any_other():
    """Nothing was commanded before it, so it starts from zero, whatever the clock says."""
    assert (
        drive(SETTINGS, INITIAL, safe(100.0), 1234.5)[1].voltage_v <= 10.0
    )  # what one tick of 1 ms allows


@given(st.lists(st.tuples(st.floats(0.0, 5e-3), st.floats(0.0, 150.0)), min_size=1, max_size=40))
def test_never_above_the_point_never_faster_than_the_rate(steps):
    state, time_s, before_v = DriveState(10.0, 0.0), 10.0, 0.0
    for elapsed_s, wanted_v in steps:
        time_s += elapsed_s
        state, command = drive(SETTINGS, state, safe(wanted_v), time_s)
        assert command.voltage_v <= wanted_v
        # 1e-10 V: rounding of a time near 10 s (2e-15 s) times the rate
        assert command.voltage_v <= before_v + 10e3 * elapsed_s + 1e-10
        assert command.output_on == (command.voltage_v > 0.0)
        before_v = command.voltage_v
