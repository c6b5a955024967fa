"""The last gate: by hand-computed limits, and against the array code that says the same in other
words.
"""

import math

import numpy as np
import pytest
from hypothesis import Phase, find, given, settings
from hypothesis import strategies as st

from haptic_driver.limits import OperatingLimits, WorstCase
from haptic_driver.render.safety import (
    INITIAL,
    SafetyState,
    Worst,
    contact_current_limit_a_rms,
    gate,
    table_of,
    violation,
    worst_at,
)
from haptic_driver.signals import OperatingPoint

LIMITS = OperatingLimits(voltage_v=150.0, frequency_low_hz=10.0, frequency_high_hz=1e6)
ROUNDING = 1e-12
NO_MORE = Worst(0.0, 0.0)  # than the point says itself


def point(frequency_hz=1e3, voltage_v=100.0, current_rms_a=1e-4, stuck_current_rms_a=2e-4):
    return OperatingPoint(
        frequency_hz, voltage_v, 0.6, current_rms_a, stuck_current_rms_a, True, 0.5, 1.0
    )


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
    p = point(
        frequency_hz=math.sqrt(limits.frequency_low_hz * limits.frequency_high_hz)
        * draw(of_a_point(-2.5, 2.5)),
        voltage_v=limits.voltage_v * draw(of_a_point(-3.0, 0.2)),
        current_rms_a=draw(of_a_point(-7.0, -1.0)),
        stuck_current_rms_a=draw(of_a_point(-6.0, 0.0)),
    )
    return limits, p, Worst(draw(of_a_point(-6.0, 0.0)), p.voltage_v * draw(of_a_point(-1.0, 1.0)))


@given(limits_and_point())
def test_gate_and_operating_limits_agree(drawn):
    limits, p, worst = drawn
    stuck_a = max(p.stuck_current_rms_a, worst.stuck_current_rms_a)
    permitted = limits.permits(
        p.frequency_hz, p.voltage_v, p.current_rms_a, stuck_a, worst.electrode_voltage_v
    )
    assert (violation(limits, p, worst) is None) == bool(permitted)


@pytest.mark.parametrize("permitted", [True, False])
def test_both_answers_come_up_in_that_comparison(permitted):
    """The comparison would be empty if every point drawn were refused, or none."""
    drawn = find(
        limits_and_point(),
        lambda drawn: (violation(*drawn) is None) is permitted,
        settings=settings(max_examples=1000, phases=[Phase.generate]),  # until one is found
    )
    assert (violation(*drawn) is None) is permitted


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


SERIES = OperatingLimits(
    150.0, 10.0, 1e6, series_resistance_ohm=100e3
)  # sqrt(2) 0.5 mA 100 kohm = 70.71 V
WEAK = OperatingLimits(
    150.0, 10.0, 1e6, amplifier_current_a=0.7e-3
)  # 0.495 mA rms: never more than 0.5 mA
SLOW = OperatingLimits(150.0, 10.0, 1e6, slew_v_per_s=1e6)  # 2 pi 10 kHz V: 15.915 V
PANEL = OperatingLimits(
    150.0, 10.0, 1e6, amplifier_current_a=0.1, panel_capacitance_f=1e-9
)  # 1 MHz: 15.915 V


@pytest.mark.parametrize(
    ("limits", "p", "allowed"),
    [
        (LIMITS, point(), True),
        (LIMITS, point(frequency_hz=9.999), False),
        (LIMITS, point(frequency_hz=10.0), True),
        (LIMITS, point(frequency_hz=1.0001e6), False),
        (LIMITS, point(voltage_v=150.0), True),
        (LIMITS, point(voltage_v=150.01), False),
        (LIMITS, point(voltage_v=-1.0), False),
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
        (WEAK, point(stuck_current_rms_a=1.0), True),
        (SLOW, point(frequency_hz=10e3, voltage_v=15.91), True),
        (SLOW, point(frequency_hz=10e3, voltage_v=15.92), False),
        (PANEL, point(frequency_hz=1e6, voltage_v=15.91), True),
        (PANEL, point(frequency_hz=1e6, voltage_v=15.92), False),
    ],
)
def test_by_hand(limits, p, allowed):
    assert (violation(limits, p, NO_MORE) is None) is allowed
    # the array code, where its inputs make sense
    if min(p.current_rms_a, p.stuck_current_rms_a) >= 0.0:
        assert (
            bool(
                limits.permits(p.frequency_hz, p.voltage_v, p.current_rms_a, p.stuck_current_rms_a)
            )
            is allowed
        )


@pytest.mark.parametrize(
    "field", ["frequency_hz", "voltage_v", "current_rms_a", "stuck_current_rms_a"]
)
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_what_is_not_finite_is_refused(field, value):
    assert (
        violation(LIMITS, point(**{field: value}), NO_MORE) == "the operating point is not finite"
    )


@given(limits=some_limits(), frequency=powers(-3.0, 9.0), current=powers(-9.0, 2.0))
def test_zero_volts_always_pass(limits, frequency, current):
    assert violation(limits, point(frequency, 0.0, current, current), NO_MORE) is None


@pytest.mark.parametrize(
    ("p", "words"),
    [
        (point(frequency_hz=5.0), "5 Hz is outside 10..1e+06 Hz"),
        (point(voltage_v=200.0), "200 V is outside 0..150 V"),
        (point(current_rms_a=1e-3), "finger current 1 mA rms exceeds 500 µA rms at 1000 Hz"),
        (point(stuck_current_rms_a=1e-3), "worst-case finger current 1 mA rms exceeds 500 µA rms"),
    ],
)
def test_the_reason_says_which_limit_and_by_how_much(p, words):
    assert words in violation(LIMITS, p, NO_MORE)


@given(limits_and_point())
def test_gate_passes_unchanged_or_gives_zero_never_something_between(drawn):
    limits, p, worst = drawn
    state, safe = gate(limits, INITIAL, p, worst)
    assert safe.frequency_hz == p.frequency_hz
    if safe.rejection is None:
        assert safe.voltage_v == p.voltage_v
        assert state == INITIAL
    else:
        assert safe.voltage_v == 0.0
        assert state == SafetyState(1)


# --- what is looked up
# -----------------------------------------------------------------------------------------

SIX_V = [0.0, 10.0, 20.0, 30.0, 40.0, 50.0]


def worst_case(stuck_a_per_v, gain=1.0, frequencies_hz=(100.0, 200.0, 400.0, 800.0)):
    """Of what finger and electrode get per volt, functions of frequency and voltage, or numbers."""
    f, v = np.array(frequencies_hz)[:, None], np.array(SIX_V)

    def nodes(per_volt):
        return np.broadcast_to(per_volt(f, v) if callable(per_volt) else per_volt, (f.size, v.size))

    return WorstCase.of(f[:, 0], v, nodes(stuck_a_per_v), nodes(gain))


@given(st.floats(100.0, 800.0), st.floats(1e-3, 50.0))
def test_what_is_proportional_is_looked_up_as_it_is(frequency_hz, voltage_v):
    table = table_of(worst_case(1e-6, 1.5))
    assert worst_at(table, frequency_hz, voltage_v) == pytest.approx(
        (1e-6 * voltage_v, 1.5 * voltage_v), rel=1e-9
    )


@pytest.mark.parametrize(
    ("stuck_a_per_v", "gain"),
    [
        (
            lambda f, v: 1e-6 / (1.0 + v / 10.0),
            lambda f, v: 1.0 / (1.0 + v / 10.0),
        ),  # bends down with voltage
        (lambda f, v: 1e-6 * (1.0 + v**2), lambda f, v: 1.0 + v / 10.0),  # and up
        (
            lambda f, v: 1e-6 * f / np.hypot(1.0, f / 300.0) + 0.0 * v,
            lambda f, v: np.hypot(1.0, f / 300.0) ** -4,
        ),
        (
            lambda f, v: 1e-6 * np.minimum(f, 310.0) + 0.0 * v,
            lambda f, v: np.minimum(f / 310.0, 1.0),
        ),  # kinks
        (
            lambda f, v: 1e-3 * np.exp(-v / 20.0),
            lambda f, v: 3.0 * np.exp(-v / 30.0),
        ),  # less at more voltage
    ],
)
@pytest.mark.parametrize("frequency_hz", [100.0, 145.0, 200.0, 290.0, 310.0, 330.0, 799.0, 800.0])
def test_what_bends_with_voltage_or_frequency_stays_below_what_is_looked_up(
    stuck_a_per_v, gain, frequency_hz
):
    """The stuck current was once taken at 150 V and scaled down, which let 6.6 times the limit
    out.
    """
    table = table_of(worst_case(stuck_a_per_v, gain))
    for voltage_v in (0.5, 3.0, 10.0, 17.0, 20.0, 49.0, 50.0):
        below_v = np.linspace(voltage_v / 100.0, voltage_v, 100)
        stuck_a, electrode_v = worst_at(table, frequency_hz, voltage_v)
        assert stuck_a >= (1.0 - 1e-9) * np.max(stuck_a_per_v(frequency_hz, below_v) * below_v)
        assert electrode_v >= (1.0 - 1e-9) * np.max(gain(frequency_hz, below_v) * below_v)


@pytest.mark.parametrize(
    ("frequency_hz", "voltage_v"),
    [(99.0, 1.0), (801.0, 1.0), (100.0, 50.1), (math.nan, 1.0), (200.0, math.nan)],
)
def test_nobody_knows_what_lies_beyond_the_table(frequency_hz, voltage_v):
    worst = Worst(*worst_at(table_of(worst_case(1e-9)), frequency_hz, voltage_v))
    assert worst == (math.inf, math.inf)
    assert "nobody knows" in violation(LIMITS, point(voltage_v=40.0), worst)


@pytest.mark.parametrize(
    ("limits", "gain"),
    [
        (LIMITS, 1.6),
        (SLOW, 1.0),
        (SLOW, 1.6),
        (SERIES, 1.0),
        (SERIES, 1.6),
        (PANEL, 1.6),
        (LIMITS, 0.5),
    ],
)
@pytest.mark.parametrize("frequency_hz", [100.0, 110.0, 200.0, 770.0])
def test_the_array_code_ends_where_the_gate_begins_to_refuse(limits, gain, frequency_hz):
    worst = worst_case(lambda f, v: 2e-5 / (1.0 + v / 100.0) + 1e-8 * f, gain)
    highest_v = limits.highest_within_v(worst.at(frequency_hz)).item()
    assert 0.0 < highest_v <= 50.0
    for share, is_allowed in ((1.0 - 1e-9, True), (1.0 + 1e-6, False)):
        p = point(frequency_hz, share * highest_v, 0.0, 0.0)
        found = violation(limits, p, Worst(*worst_at(table_of(worst), p.frequency_hz, p.voltage_v)))
        assert (found is None) == is_allowed
