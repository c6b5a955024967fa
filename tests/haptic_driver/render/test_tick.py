"""One tick end to end: the stages in order, off without contact, off after a refusal."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptic_driver.render.controller import Controller, ControllerSettings
from haptic_driver.render.drive import DriveSettings
from haptic_driver.render.finger import FingerSettings
from haptic_driver.render.safety import table_of
from haptic_driver.render.texture import Grating, Uniform
from haptic_driver.render.tick import TickSettings, TickState, tick
from haptic_driver.signals import FingerSample
from model.conditions import Conditions


@pytest.fixture(scope="module")
def settings(surface, surface_file, limits):
    return TickSettings(
        finger=FingerSettings(contact_on_n=0.15, contact_off_n=0.10),
        texture=Uniform(0.6),
        controller=Controller(ControllerSettings(surface, limits)),
        limits=limits,
        drive=DriveSettings(voltage_rise_v_per_s=10e3),
        worst_case=table_of(surface_file.worst_case(limits)),
    )


def run(settings, forces, state=None, start_s=1.0, speed_m_s=0.0):
    """One tick per force, 1 ms apart."""
    state, done = state or TickState(), []
    for k, force in enumerate(forces):
        time_s = start_s + 1e-3 * k
        state, one = tick(
            settings, state, FingerSample(time_s, 0.01 + speed_m_s * 1e-3 * k, 0.0, force)
        )
        done.append(one)
    return state, done


def test_touch_rises_to_the_voltage_that_gives_the_target(settings, touch):
    _, done = run(settings, [0.0] + [0.5] * 40)
    rising = [d.command.voltage_v for d in done]
    assert np.diff(rising).max() <= 10.0 + 1e-9  # 10 V per tick of 1 ms
    command = done[-1].command
    assert command.output_on
    answer = touch.predict(
        Conditions(*(np.array([x]) for x in (command.frequency_hz, command.voltage_v, 0.5)))
    )
    assert answer.cof[0] == pytest.approx(0.6, rel=1e-3)  # the inversion's promise


def test_lifting_switches_off_within_the_same_tick(settings):
    state, _ = run(settings, [0.5] * 40)
    _, done = run(settings, [0.11, 0.09], state, start_s=1.04)
    assert [d.command.output_on for d in done] == [True, False]
    assert done[-1].command.voltage_v == 0.0


@pytest.mark.parametrize(
    "spoilt",
    [
        FingerSample(1.04, math.nan, 0.0, 0.5),
        FingerSample(1.04, 0.01, math.inf, 0.5),
        FingerSample(1.04, 0.01, 0.0, math.nan),
        FingerSample(math.nan, 0.01, 0.0, 0.5),
        FingerSample(0.5, 0.01, 0.0, 0.5),
    ],
)
def test_a_spoilt_sample_switches_off(settings, spoilt):
    state, done = run(settings, [0.5] * 40)
    assert done[-1].command.output_on
    _, one = tick(settings, state, spoilt)
    assert one.command.output_on is False
    assert one.command.voltage_v == 0.0


def test_a_sample_without_a_time_does_not_lift_the_bound_on_the_rise(settings):
    state, _ = tick(settings, TickState(), FingerSample(1.0, 0.01, 0.0, 0.0))
    state, _ = tick(settings, state, FingerSample(math.nan, 0.01, 0.0, 0.0))
    _, one = tick(settings, state, FingerSample(1.001, 0.01, 0.0, 0.5))
    assert one.command.voltage_v <= 10.0 + 1e-9


def test_what_the_gate_refuses_is_off_and_counted(settings, limits):
    """The surface was made ready for 150 V; a gate that knows of 50 V refuses what it offers, and
    does not clamp.
    """
    strict = replace(settings, limits=replace(limits, voltage_v=50.0))
    state, done = run(strict, [0.0] + [0.5] * 10)
    assert state.safety.rejections == 10
    assert "V is outside 0..50 V" in done[-1].safe.rejection
    assert done[-1].wanted.voltage_v > 50.0
    assert done[-1].safe.voltage_v == 0.0
    assert not any(d.command.output_on for d in done)
    state, _ = run(strict, [0.0] * 3, state, start_s=2.0)
    assert state.safety.rejections == 10


anything = st.floats(allow_nan=True, allow_infinity=True)
POSITIONS = st.one_of(st.floats(-0.1, 0.1), anything)
FORCES = st.one_of(st.floats(0.0, 3.0), anything)
SAMPLES = st.lists(st.tuples(st.floats(0.0, 0.02), POSITIONS, FORCES), min_size=1, max_size=25)


@given(samples=SAMPLES, mean=st.floats(0.02, 3.0))
def test_whatever_the_finger_does_the_command_is_safe(settings, refusal, limits, samples, mean):
    settings = replace(settings, texture=Grating(mean, 0.5 * mean, 2e-3))
    state, time_s, before_v = TickState(), 1.0, 0.0
    state, _ = tick(settings, state, FingerSample(time_s, 0.0, 0.0, 0.0))
    for elapsed_s, x_m, force_n in samples:
        time_s += elapsed_s
        state, one = tick(settings, state, FingerSample(time_s, x_m, 0.0, force_n))
        command = one.command
        assert 0.0 <= command.voltage_v <= limits.voltage_v
        assert math.isfinite(command.frequency_hz)
        assert command.output_on == (command.voltage_v > 0.0)
        if command.output_on:
            assert one.finger.in_contact
            assert refusal(limits, one.wanted) is None
        # 1e-10 V: rounding of a time near 1 s times the rate
        assert command.voltage_v <= before_v + 10e3 * elapsed_s + 1e-10
        before_v = command.voltage_v
    assert state.safety.rejections == 0
