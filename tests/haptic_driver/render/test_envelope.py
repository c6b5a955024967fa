"""The envelope within a tick: the texture along the finger's way, force straight between points,
the last gate.
"""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptic_driver.limits import OperatingLimits
from haptic_driver.render import safety
from haptic_driver.render.controller import Controller, ControllerSettings
from haptic_driver.render.drive import DriveSettings
from haptic_driver.render.envelope import ahead, full_scale_v, straight, synthesise
from haptic_driver.render.finger import FingerSettings
from haptic_driver.render.safety import gate_envelope
from haptic_driver.render.texture import Grating, Profile, Script, Step, Uniform
from haptic_driver.render.tick import TickSettings, TickState, tick
from haptic_driver.signals import COURSE_POINTS, FingerSample, OperatingPoint
from model.conditions import Conditions

CARRIER_HZ = 250.0
TICK_S, SAMPLES = 1e-3, 50


@pytest.fixture(scope="module")
def stages(surface, surface_file, limits):
    return TickSettings(
        FingerSettings(),
        Uniform(0.7),
        Controller(ControllerSettings(surface, limits, "fixed_frequency", CARRIER_HZ)),
        limits,
        DriveSettings(),
        safety.table_of(surface_file.worst_case(limits)),
    )


def play(stages, texture, count=200, speed_m_s=0.1, force_n=0.5):
    """Voltage squared at the points of the way of a finger that slides from x = 10 mm on; and the
    last state.
    """
    stages = replace(stages, texture=texture)
    state, courses = TickState(), []
    for k in range(count):
        sample = FingerSample(1.0 + TICK_S * k, 0.01 + speed_m_s * TICK_S * k, 0.0, force_n)
        state, done = tick(stages, state, sample)
        if done.command.voltage_v == done.wanted.voltage_v:
            state, course_v2 = ahead(stages, state, done, TICK_S)
        else:
            course_v2 = straight(courses[-1][-1] if courses else 0.0, done.command.voltage_v**2)
        courses.append(course_v2)
    return state, np.concatenate(courses)


def played(courses):
    """Samples at 50 kHz."""
    powers_v2 = np.concatenate(((0.0,), courses[1]))
    samples_v = np.empty(courses[1].size // COURSE_POINTS * SAMPLES)
    synthesise(powers_v2, samples_v)
    return samples_v


def test_a_steady_target_gives_the_voltage_that_the_model_wants(stages, touch):
    voltage_v = played(play(stages, Uniform(0.7), 50))[-SAMPLES:]
    assert np.ptp(voltage_v) < 1e-9
    drive = (np.array([x]) for x in (CARRIER_HZ, voltage_v[0], 0.5))
    assert touch.predict(Conditions(*drive)).cof[0] == pytest.approx(
        0.7, rel=1e-3
    )  # the inversion's promise


@pytest.mark.parametrize("texture_hz", [50.0, 800.0])
def test_texture_far_above_the_ticks_own_rate_reaches_the_friction(stages, touch, texture_hz):
    """At 100 mm/s; friction by the direct model at every sample, against the grating under the
    finger.
    """
    grating = Grating(0.7, 0.1, 0.1 / texture_hz)
    voltage_v = played(play(stages, grating))[-5000:]  # 100 ms
    given_v = np.linspace(
        0.0, 130.0, 400
    )  # friction is smooth: the model at these, a line between them
    cof = touch.predict(Conditions(np.full(400, CARRIER_HZ), given_v, np.full(400, 0.5))).cof
    felt = np.interp(voltage_v, given_v, cof)
    x_m = 0.01 + 0.1 * 1e-3 * 100 + 0.1 * (np.arange(5000) + 1) / 50e3
    # straight lines at 800 Hz: 1 % of it at crests
    assert np.abs(felt - grating.cof_at(x_m, np.zeros(5000))).max() < 0.004


def test_a_touch_comes_up_at_the_drive_stages_rate(stages):
    """10 V per millisecond, in lines that are straight in voltage squared: at most the root of 10 V
    x 10 V at first.
    """
    voltage_v = played(play(stages, Uniform(0.7), 30, speed_m_s=0.0))
    full_v = voltage_v[-1]
    each_ms = voltage_v[SAMPLES - 1 :: SAMPLES]
    assert np.diff(each_ms).max() == pytest.approx(10.0, abs=0.01)
    assert each_ms[0] == 0.0  # time has not passed yet
    assert (np.diff(voltage_v) > -1e-9).all()
    assert voltage_v[math.ceil(full_v / 10.0 + 1.0) * SAMPLES :] == pytest.approx(full_v)


def test_a_fall_is_at_once_and_a_rise_straight():
    assert (straight(400.0, 100.0) == 100.0).all()
    assert straight(0.0, 100.0) == pytest.approx(
        np.arange(1, COURSE_POINTS + 1) / COURSE_POINTS * 100.0
    )


def test_without_contact_and_off_the_texture_there_is_nothing(stages):
    assert not play(stages, Uniform(0.7), 5, force_n=0.02)[1].any()
    assert not play(stages, Profile([0.5, 0.6], [0.7, 0.7]), 5)[1].any()


def test_a_script_plays_its_textures_within_a_tick_too(stages):
    """Held alone; half way from one friction to the same texture on top of it, the sum of
    halves.
    """
    grating = Grating(0.7, 0.1, 0.1 / 800.0)
    held = Script((Step(0.0, grating), Step(9.0, Uniform(0.5))), start_s=1.0)
    np.testing.assert_array_equal(play(stages, held)[1], play(stages, grating)[1])
    faded = Script(
        (Step(-9.0, Uniform(0.7), "linear"), Step(9.0, Grating(0.7, 0.2, 0.1 / 800.0))), start_s=1.1
    )
    _, at_once = play(stages, faded, 101)  # the last tick is at 1.1 s, half way
    # Up to there the amplitude has grown by 0.1 / 9 s of 0.1 s: 0.1 %, and another rise with it.
    np.testing.assert_allclose(
        at_once[-COURSE_POINTS:], play(stages, grating, 101)[1][-COURSE_POINTS:], rtol=2e-3
    )


def test_root_of_straight_force():
    out = np.empty(4)
    synthesise(np.array([100.0, 400.0, 0.0]), out)
    np.testing.assert_allclose(out, np.sqrt([250.0, 400.0, 200.0, 0.0]))


# --- the last gate
# ---------------------------------------------------------------------------------------------

NO_MORE = safety.Worst(0.0, 0.0)  # than the point says itself
PEAK = OperatingPoint(250.0, 100.0, 0.8, 1e-5, 1e-5, True, 0.5, 0.9)


@given(
    st.lists(st.floats(0.0, 100.0), min_size=1, max_size=60),
    st.integers(0, 59),
    st.sampled_from([100.1, -1e-9, math.nan, math.inf]),
)
def test_one_bad_point_refuses_all(samples, where, bad):
    limits = OperatingLimits(150.0, 1.0, 1e6)
    block = np.array(samples)
    assert gate_envelope(limits, safety.INITIAL, PEAK, NO_MORE, block) == (safety.INITIAL, False)
    where = min(where, block.size - 1)
    block[where] = bad
    state, refused = gate_envelope(limits, safety.INITIAL, PEAK, NO_MORE, block)
    assert refused
    assert state.rejections == 1


@pytest.mark.parametrize(
    "tight",
    [
        {"voltage_v": 99.0},
        {"frequency_high_hz": 200.0},
        {"slew_v_per_s": 1e5},
        {"contact_current_a_rms": ((1.0, 1e-6),)},
        {"amplifier_current_a": 1e-6, "panel_capacitance_f": 1e-9},
    ],
)
def test_a_peak_beyond_any_limit_refuses_the_block(tight):
    limits = OperatingLimits(
        **({"voltage_v": 150.0, "frequency_low_hz": 1.0, "frequency_high_hz": 1e6} | tight)
    )
    assert gate_envelope(limits, safety.INITIAL, PEAK, NO_MORE, np.full(50, 1.0))[1]


def test_a_refusal_of_the_envelopes_own_gate_is_counted(stages, limits):
    """The tick asks for little here, the way ahead for more than the gate allows."""
    steep = Profile([0.0, 0.0109, 0.0110, 1.0], [0.52, 0.52, 0.9, 0.9], "clamp")
    strict = replace(stages, limits=replace(limits, voltage_v=60.0))
    state, powers_v2 = play(strict, steep, 10)
    assert state.safety.rejections >= 1
    assert powers_v2.max() <= 60.0**2


def test_the_carrier_is_as_high_as_is_allowed_there_and_no_higher(stages, surface_file, limits):
    """An open modulation input once put 150 V out at any carrier, up to 4.4 times the current that
    is allowed.
    """
    for carrier_hz in surface_file.frequency_hz[::10]:
        most_v = full_scale_v(stages, float(carrier_hz))
        stuck_a = (
            most_v
            * surface_file.stuck_current_a_per_v[surface_file.frequency_hz == carrier_hz].max()
        )
        allowed_a = limits.contact_current_limit_a_rms(carrier_hz)
        assert 0.0 < most_v <= limits.voltage_v
        assert stuck_a <= allowed_a
        assert (
            most_v > 0.999 * limits.voltage_v or stuck_a > 0.99 * allowed_a
        )  # nothing is given away


def test_where_the_gate_disagrees_there_is_no_carrier(stages, limits):
    assert full_scale_v(replace(stages, limits=replace(limits, voltage_v=50.0)), CARRIER_HZ) == 0.0
