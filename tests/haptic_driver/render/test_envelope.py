"""The envelope within a tick: the texture along the finger's way, force straight between points, the last gate."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptic_driver.errors import BadInputError
from haptic_driver.limits import OperatingLimits
from haptic_driver.render import safety
from haptic_driver.render.controller import Controller, ControllerSettings
from haptic_driver.render.drive import DriveSettings
from haptic_driver.render.envelope import EnvelopeSettings, EnvelopeState, envelope, synthesise
from haptic_driver.render.finger import FingerSettings
from haptic_driver.render.safety import first_outside, gate_envelope
from haptic_driver.render.texture import Grating, Profile, Uniform
from haptic_driver.render.tick import TickSettings, TickState, tick
from haptic_driver.signals import FingerSample, OperatingPoint
from model.touch_model import Conditions

CARRIER_HZ = 250.0
SETTINGS = EnvelopeSettings()


@pytest.fixture(scope="module")
def stages(surface, limits):
    return TickSettings(
        FingerSettings(),
        Uniform(0.7),
        Controller(ControllerSettings(surface, limits, "fixed_frequency", CARRIER_HZ)),
        limits,
        DriveSettings(),
    )


def play(stages, texture, count=200, speed_m_s=0.1, force_n=0.5):
    """Blocks of a finger that slides from x = 10 mm on; and the last tick."""
    stages = replace(stages, texture=texture)
    state, state_of_envelope, blocks = TickState(), EnvelopeState(), []
    for k in range(count):
        sample = FingerSample(1.0 + 1e-3 * k, 0.01 + speed_m_s * 1e-3 * k, 0.0, force_n)
        state, done = tick(stages, state, sample)
        state_of_envelope, block = envelope(SETTINGS, stages, state_of_envelope, state, done)
        blocks.append(block)
    return state_of_envelope, blocks


def played(blocks):
    return np.concatenate([block.voltage_v for block in blocks])


def test_a_steady_target_gives_the_voltage_that_the_model_wants(stages, touch):
    _, blocks = play(stages, Uniform(0.7), 50)
    last = blocks[-1]
    assert last.output_on
    assert last.frequency_hz == CARRIER_HZ
    assert np.ptp(last.voltage_v) < 1e-9
    drive = (np.array([x]) for x in (CARRIER_HZ, last.voltage_v[0], 0.5))
    assert touch.predict(Conditions(*drive)).cof[0] == pytest.approx(0.7, rel=1e-3)  # the inversion's promise


@pytest.mark.parametrize("texture_hz", [50.0, 800.0])
def test_texture_far_above_the_ticks_own_rate_reaches_the_friction(stages, touch, texture_hz):
    """At 100 mm/s; friction by the direct model at every sample, against the grating under the finger."""
    grating = Grating(0.7, 0.1, 0.1 / texture_hz)
    voltage_v = played(play(stages, grating)[1])[-5000:]  # 100 ms
    given_v = np.linspace(0.0, 130.0, 400)  # friction is smooth: the model at these, a line between them
    cof = touch.predict(Conditions(np.full(400, CARRIER_HZ), given_v, np.full(400, 0.5))).cof
    felt = np.interp(voltage_v, given_v, cof)
    x_m = 0.01 + 0.1 * 1e-3 * 100 + 0.1 * (np.arange(5000) + 1) / 50e3
    assert (
        np.abs(felt - grating.cof_at(x_m, np.zeros(5000))).max() < 0.004
    )  # straight lines at 800 Hz: 1 % of it at crests


def test_held_from_tick_to_tick_the_same_texture_is_lost(stages):
    """What the envelope is for: ticks see 800 Hz at 1 kHz as 200 Hz."""
    grating = Grating(0.7, 0.1, 0.1 / 800.0)
    power = played(play(stages, grating)[1])[-5000:] ** 2
    spectrum = np.abs(np.fft.rfft(power - power.mean()))
    assert 10.0 * spectrum.argmax() == 800.0
    held = np.repeat(power[49::50], 50)
    assert 10.0 * np.abs(np.fft.rfft(held - held.mean())).argmax() == 200.0


def test_a_touch_comes_up_within_its_rise(stages):
    _, blocks = play(stages, Uniform(0.7), 30, speed_m_s=0.0)
    voltage_v = played(blocks)
    full_v = voltage_v[-1]
    assert np.diff(voltage_v[: SETTINGS.samples * 10]).max() < 0.05 * full_v
    assert voltage_v[SETTINGS.samples * 10 :] == pytest.approx(full_v)
    assert voltage_v[0] < 0.01 * full_v


def test_without_contact_and_off_the_texture_there_is_nothing(stages):
    _, blocks = play(stages, Uniform(0.7), 5, force_n=0.02)
    assert not any(block.output_on for block in blocks)
    assert not played(blocks).any()
    _, blocks = play(stages, Profile([0.5, 0.6], [0.7, 0.7]), 5)
    assert not played(blocks).any()


def test_no_step_between_blocks_but_the_textures_own(stages):
    voltage_v = played(play(stages, Grating(0.7, 0.1, 0.01))[1])[1000:]
    # 10 Hz between 70 and 110 V: at most 2 pi 10 Hz 20 V / 50 kHz = 0.025 V per sample, twice that for its asymmetry
    assert np.abs(np.diff(voltage_v)).max() < 0.05


def test_root_of_straight_force():
    out = np.empty(4)
    synthesise(np.array([100.0, 400.0, 0.0]), 1.0, 1.0, out)
    np.testing.assert_allclose(out, np.sqrt([250.0, 400.0, 200.0, 0.0]))
    synthesise(np.array([100.0, 100.0]), 0.0, 1.0, out)
    np.testing.assert_allclose(out, [2.5, 5.0, 7.5, 10.0])


# --- the last gate ---------------------------------------------------------------------------------------------

PEAK = OperatingPoint(250.0, 100.0, 0.8, 1e-5, 1e-5, True, 0.5, 0.9)


@given(
    st.lists(st.floats(0.0, 100.0), min_size=1, max_size=60),
    st.integers(0, 59),
    st.sampled_from([100.1, -1e-9, math.nan, math.inf]),
)
def test_one_bad_sample_refuses_the_block(samples, where, bad):
    limits = OperatingLimits(150.0, 1.0, 1e6)
    block = np.array(samples)
    assert gate_envelope(limits, safety.INITIAL, PEAK, block) == (safety.INITIAL, False)
    where = min(where, block.size - 1)
    block[where] = bad
    assert first_outside(block, 100.0) == where
    state, refused = gate_envelope(limits, safety.INITIAL, PEAK, block)
    assert refused
    assert state.rejections == 1
    assert f"sample {where}" in state.last_reason


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
    limits = OperatingLimits(**({"voltage_v": 150.0, "frequency_low_hz": 1.0, "frequency_high_hz": 1e6} | tight))
    assert gate_envelope(limits, safety.INITIAL, PEAK, np.full(50, 1.0))[1]


def test_a_refused_block_is_zero_and_the_touch_comes_up_anew(stages, limits):
    """The surface was made ready for 150 V; a gate that knows of 50 V refuses what it offers."""
    strict = replace(stages, limits=replace(limits, voltage_v=50.0))
    state, blocks = play(strict, Uniform(0.7), 20)
    assert not any(block.output_on for block in blocks)
    assert not played(blocks).any()
    assert state.risen == 0.0


def test_a_refusal_of_the_envelopes_own_gate_is_counted(stages, limits):
    """The tick asks for little here, the way ahead for more than the gate allows."""
    steep = Profile([0.0, 0.0109, 0.0110, 1.0], [0.52, 0.52, 0.9, 0.9], "clamp")
    strict = replace(
        stages, limits=replace(limits, voltage_v=60.0), finger=FingerSettings(velocity_time_constant_s=1e-3)
    )
    state, blocks = play(strict, steep, 10)
    assert state.safety.rejections >= 1
    assert max(block.voltage_v.max() for block in blocks) <= 60.0


@pytest.mark.parametrize("wrong", [{"points": 0}, {"points": 51}, {"tick_s": 0.0}, {"rise_s": math.nan}])
def test_settings_without_meaning_are_refused(wrong):
    with pytest.raises(BadInputError):
        EnvelopeSettings(**wrong)
