"""The last gate: by hand-computed limits, and against the array code that says the same in other words."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptic_driver.limits import ICNIRP_PUBLIC_A_RMS, OperatingLimits
from haptic_driver.render.safety import INITIAL, SafetyState, contact_current_limit_a_rms, gate, violation
from haptic_driver.signals import OperatingPoint

LIMITS = OperatingLimits(voltage_v=150.0, frequency_low_hz=10.0, frequency_high_hz=1e6)
ROUNDING = 1e-12


def point(frequency_hz=1e3, voltage_v=100.0, current_rms_a=1e-4, stuck_current_rms_a=2e-4):
    return OperatingPoint(frequency_hz, voltage_v, 0.6, current_rms_a, stuck_current_rms_a, True, 0.5, 1.0)


def powers(low, high, off=1.0000137):
    """Log-uniform, and a little off every round number."""
    return st.floats(low, high).map(lambda x: off * 10.0**x)


def of_a_point(low, high):
    """Never equal to one of the limits, where rounding may decide either way."""
    return powers(low, high, off=1.0000071)


@st.composite
def some_limits(draw):
    curve_f = sorted(draw(st.lists(powers(0.0, 7.0), min_size=1, max_size=4, unique=True)))
    low = draw(powers(-1.0, 4.0))
    return OperatingLimits(
        voltage_v=draw(powers(0.0, 3.0)),
        frequency_low_hz=low,
        frequency_high_hz=low * draw(powers(0.1, 4.0)),
        slew_v_per_s=draw(st.one_of(st.just(math.inf), powers(3.0, 9.0))),
        contact_current_a_rms=tuple((f, draw(powers(-4.0, -1.0))) for f in curve_f),
        series_resistance_ohm=draw(st.one_of(st.just(0.0), powers(1.0, 6.0))),
        amplifier_current_a=draw(st.one_of(st.just(math.inf), powers(-5.0, 0.0))),
        panel_capacitance_f=draw(st.one_of(st.just(0.0), powers(-12.0, -8.0))),
    )


@st.composite
def limits_and_point(draw):
    limits = draw(some_limits())
    return limits, point(
        frequency_hz=math.sqrt(limits.frequency_low_hz * limits.frequency_high_hz) * draw(of_a_point(-2.5, 2.5)),
        voltage_v=limits.voltage_v * draw(of_a_point(-3.0, 0.2)),
        current_rms_a=draw(of_a_point(-7.0, -1.0)),
        stuck_current_rms_a=draw(of_a_point(-6.0, 0.0)),
    )


@given(limits_and_point())
def test_gate_and_operating_limits_agree(drawn):
    limits, p = drawn
    permitted = limits.permits(p.frequency_hz, p.voltage_v, p.current_rms_a, p.stuck_current_rms_a)
    assert (violation(limits, p) is None) == bool(permitted)


def test_both_answers_come_up_in_that_comparison():
    """The comparison would be empty if every point drawn were refused, or none."""
    answers = set()

    @given(limits_and_point())
    def collect(drawn):
        answers.add(violation(*drawn) is None)

    collect()
    assert answers == {True, False}


@pytest.mark.parametrize(
    ("frequency_hz", "limit_a"),
    [
        (0.1, 0.5e-3),  # held below the first point
        (1.0, 0.5e-3),
        (1e3, 0.5e-3),
        (2.5e3, 0.5e-3),
        (5e3, 1e-3),  # 0.2 mA per kHz from 2.5 kHz to 100 kHz
        (10e3, 2e-3),
        (50e3, 10e-3),
        (100e3, 20e-3),
        (1e6, 20e-3),
        (50e6, 20e-3),  # held above the last point
    ],
)
def test_icnirp_curve(frequency_hz, limit_a):
    assert contact_current_limit_a_rms(LIMITS, frequency_hz) == pytest.approx(limit_a, rel=ROUNDING)
    assert LIMITS.contact_current_limit_a_rms(frequency_hz) == pytest.approx(limit_a, rel=ROUNDING)


def test_default_curve_is_the_general_public_one():
    assert ICNIRP_PUBLIC_A_RMS == ((1.0, 0.5e-3), (2.5e3, 0.5e-3), (100e3, 20e-3), (10e6, 20e-3))
    assert LIMITS.contact_current_a_rms == ICNIRP_PUBLIC_A_RMS


SERIES = OperatingLimits(150.0, 10.0, 1e6, series_resistance_ohm=100e3)  # sqrt(2) 0.5 mA 100 kohm = 70.71 V
WEAK = OperatingLimits(150.0, 10.0, 1e6, amplifier_current_a=0.7e-3)  # 0.495 mA rms: never more than 0.5 mA
SLOW = OperatingLimits(150.0, 10.0, 1e6, slew_v_per_s=1e6)  # 2 pi 10 kHz V: 15.915 V
PANEL = OperatingLimits(150.0, 10.0, 1e6, amplifier_current_a=0.1, panel_capacitance_f=1e-9)  # 1 MHz: 15.915 V


@pytest.mark.parametrize(
    ("limits", "p", "allowed"),
    [
        (LIMITS, point(), True),
        (LIMITS, point(frequency_hz=9.999), False),
        (LIMITS, point(frequency_hz=10.0), True),
        (LIMITS, point(frequency_hz=1e6), True),
        (LIMITS, point(frequency_hz=1.0001e6), False),
        (LIMITS, point(voltage_v=150.0), True),
        (LIMITS, point(voltage_v=150.01), False),
        (LIMITS, point(voltage_v=-1.0), False),
        (LIMITS, point(current_rms_a=0.0, stuck_current_rms_a=0.0), True),
        (LIMITS, point(current_rms_a=0.499e-3), True),
        (LIMITS, point(current_rms_a=0.501e-3), False),
        (LIMITS, point(current_rms_a=-1e-9), False),
        (LIMITS, point(stuck_current_rms_a=0.499e-3), True),
        (LIMITS, point(stuck_current_rms_a=0.501e-3), False),
        (LIMITS, point(stuck_current_rms_a=-1e-9), False),
        (LIMITS, point(frequency_hz=20e3, stuck_current_rms_a=3.9e-3), True),
        (LIMITS, point(frequency_hz=20e3, stuck_current_rms_a=4.1e-3), False),
        (SERIES, point(voltage_v=70.7, stuck_current_rms_a=1.0), True),
        (SERIES, point(voltage_v=70.8, stuck_current_rms_a=1.0), False),
        (SERIES, point(voltage_v=70.7, current_rms_a=0.6e-3, stuck_current_rms_a=1.0), False),
        (WEAK, point(stuck_current_rms_a=1.0), True),
        (WEAK, point(current_rms_a=0.6e-3, stuck_current_rms_a=1.0), False),
        (SLOW, point(frequency_hz=10e3, voltage_v=15.91), True),
        (SLOW, point(frequency_hz=10e3, voltage_v=15.92), False),
        (PANEL, point(frequency_hz=1e6, voltage_v=15.91), True),
        (PANEL, point(frequency_hz=1e6, voltage_v=15.92), False),
    ],
)
def test_by_hand(limits, p, allowed):
    assert (violation(limits, p) is None) is allowed
    # the array code, where its inputs make sense
    if min(p.current_rms_a, p.stuck_current_rms_a) >= 0.0:
        assert bool(limits.permits(p.frequency_hz, p.voltage_v, p.current_rms_a, p.stuck_current_rms_a)) is allowed


@pytest.mark.parametrize("field", ["frequency_hz", "voltage_v", "current_rms_a", "stuck_current_rms_a"])
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_what_is_not_finite_is_refused(field, value):
    assert violation(LIMITS, point(**{field: value})) == "the operating point is not finite"


@given(limits=some_limits(), frequency=powers(-3.0, 9.0), current=powers(-9.0, 2.0))
def test_zero_volts_always_pass(limits, frequency, current):
    assert violation(limits, point(frequency, 0.0, current, current)) is None


@pytest.mark.parametrize(
    ("p", "words"),
    [
        (point(frequency_hz=5.0), "5 Hz is outside 10..1e+06 Hz"),
        (point(voltage_v=200.0), "200 V is outside 0..150 V"),
        (point(current_rms_a=1e-3), "finger current 0.001 A rms exceeds 0.0005 A rms at 1000 Hz"),
        (point(stuck_current_rms_a=1e-3), "worst-case finger current 0.001 A rms exceeds 0.0005 A rms"),
    ],
)
def test_the_reason_says_which_limit_and_by_how_much(p, words):
    assert words in violation(LIMITS, p)


@given(limits_and_point())
def test_gate_passes_unchanged_or_gives_zero_never_something_between(drawn):
    limits, p = drawn
    state, safe = gate(limits, INITIAL, p)
    assert safe.frequency_hz == p.frequency_hz
    if safe.rejection is None:
        assert safe.voltage_v == p.voltage_v
        assert state == INITIAL
    else:
        assert safe.voltage_v == 0.0
        assert state == SafetyState(1, safe.rejection)


def test_rejections_are_counted_and_the_last_reason_stays():
    state, _ = gate(LIMITS, INITIAL, point(voltage_v=200.0))
    state, _ = gate(LIMITS, state, point())
    assert state == SafetyState(1, "200 V is outside 0..150 V peak at the electrode")
    state, _ = gate(LIMITS, state, point(frequency_hz=5.0))
    state, _ = gate(LIMITS, state, point())
    assert state == SafetyState(2, "5 Hz is outside 10..1e+06 Hz")
