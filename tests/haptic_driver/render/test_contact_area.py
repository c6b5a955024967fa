"""A touch whose area the screen tells: friction is looked up for that, as the model has it."""

import math

import numpy as np
import pytest

from haptic_driver.lookup.file import by_pressure, with_areas
from haptic_driver.render.controller import INITIAL, Controller, ControllerSettings
from haptic_driver.render.correction import NO_CORRECTION
from haptic_driver.render.feedback import Estimate, FeedbackSettings, InForce, by_surface
from haptic_driver.render.surface import as_solved
from haptic_driver.render.texture import Uniform
from haptic_driver.render.tick import TickState, tick
from haptic_driver.rig.tick_settings import tick_settings
from haptic_driver.signals import NO_COMMAND, FingerSample, FingerState, TargetFriction
from haptic_driver.simulation.finger_model import with_hidden
from model.conditions import Conditions

HZ, LOAD_N = 200.0, 0.5
FINGER = FingerState(0.0, 0.05, 0.03, 0.05, 0.0, LOAD_N, True)
USUAL_M2 = 100e-6  # of the surface's finger
UNKNOWN = np.empty(0)  # no pressures
WITHIN = 5e-3  # the surface's own error, and a little


@pytest.fixture(scope="module")
def surface(surface, touch):
    return with_areas(surface, touch)


def made(surface, limits, feedback=None):
    settings = ControllerSettings(
        surface,
        limits,
        policy="fixed_frequency",
        fixed_frequency_hz=HZ,
        lowest_carrier_hz=1.0,
        feedback=feedback,
    )
    return Controller(settings)


def learning(surface, limits):
    return made(surface, limits, FeedbackSettings(0.03))


def operating_point(surface, limits, finger, target_cof):
    target = TargetFriction(target_cof, True)
    return made(surface, limits).step(INITIAL, target, finger, NO_COMMAND)[1]


def voltage_for(surface, limits, finger, target_cof):
    return operating_point(surface, limits, finger, target_cof).voltage_v


@pytest.mark.parametrize("share", [0.5, 0.8, 1.25, 2.0])
def test_friction_is_that_of_a_finger_with_the_area_told(surface, limits, touch, share):
    """The model is asked for such a finger itself; the look-up knows only the usual one."""
    area_m2 = share * USUAL_M2
    finger = FINGER._replace(contact_area_m2=area_m2)
    for target_cof in (0.55, 0.7):
        voltage_v = voltage_for(surface, limits, finger, target_cof)
        one = (np.array([x]) for x in (HZ, voltage_v, LOAD_N))
        felt = touch.cof(Conditions(*one, contact_area_m2=np.array([area_m2])))[0]
        assert felt == pytest.approx(target_cof, rel=WITHIN)


def test_the_area_of_the_surfaces_own_finger_changes_nothing(surface):
    told = FINGER._replace(contact_area_m2=USUAL_M2)
    assert as_solved(surface, told).normal_force_n == pytest.approx(LOAD_N, rel=1e-12)


@pytest.mark.parametrize("area_m2", [math.nan, 0.0, -1e-4, math.inf])
def test_an_area_that_is_unknown_leaves_the_load(surface, area_m2):
    told = FINGER._replace(contact_area_m2=area_m2)
    assert as_solved(surface, told).normal_force_n == LOAD_N


@pytest.mark.parametrize(("area_m2", "end"), [(1e-7, -1), (9e-3, 0)])
def test_a_pressure_beyond_the_surface_is_that_of_its_end(surface, area_m2, end):
    """It fell back to the load itself, and the voltage jumped there with the area's noise."""
    told = FINGER._replace(contact_area_m2=area_m2)
    found_n = as_solved(surface, told).normal_force_n
    assert found_n == pytest.approx(math.exp(surface.log_normal_force[end]), rel=1e-9)


@pytest.mark.parametrize("share", [0.5, 2.0])
def test_the_sliding_current_is_that_of_the_area(surface, limits, touch, share):
    area_m2 = share * USUAL_M2
    finger = FINGER._replace(contact_area_m2=area_m2)
    point = operating_point(surface, limits, finger, 0.6)
    one = (np.array([x]) for x in (HZ, point.voltage_v, LOAD_N))
    there = touch.predict(Conditions(*one, contact_area_m2=np.array([area_m2])))
    assert point.current_rms_a == pytest.approx(there.current_rms_a[0], rel=WITHIN)


def test_the_points_of_an_envelope_are_for_the_area_too(surface, limits):
    finger = FINGER._replace(contact_area_m2=2.0 * USUAL_M2)
    controller = made(surface, limits)
    expected = controller.step(INITIAL, TargetFriction(0.6, True), finger, NO_COMMAND)[1]
    voltages_v, peak = controller.along(Estimate(), np.array([0.6]), finger, HZ)
    assert voltages_v[0] == pytest.approx(expected.voltage_v, rel=1e-6)
    assert peak.current_rms_a == pytest.approx(expected.current_rms_a, rel=1e-6)


def test_feedback_expects_the_friction_of_the_area(surface, touch):
    area_m2 = 2.0 * USUAL_M2
    finger = FINGER._replace(contact_area_m2=area_m2)
    drive = InForce(HZ, 100.0, 100.0, 100.0, True)
    forces_n, _ = by_surface(surface, NO_CORRECTION, drive, finger)
    one = (np.array([x]) for x in (HZ, 100.0, LOAD_N))
    felt = touch.cof(Conditions(*one, contact_area_m2=np.array([area_m2])))[0]
    assert sum(forces_n) == pytest.approx(LOAD_N * felt, rel=WITHIN)


def test_a_swap_to_a_surface_of_that_area_moves_no_friction(surface, limits):
    """The gains are carried by what both surfaces say of the touch as it is."""
    finger = FINGER._replace(contact_area_m2=2.0 * USUAL_M2)
    of_both = [learning(surface, limits), learning(surface._replace(log_pressure=UNKNOWN), limits)]
    target = TargetFriction(0.6, True)
    state, point = of_both[0].step(INITIAL, target, finger, NO_COMMAND)
    after = of_both[1].carried(of_both[0], state, 0.05, 0.0, point.voltage_v)
    gains = after.estimate.gains
    low_n, rise_n = by_surface(
        of_both[1].settings.surface,
        NO_CORRECTION,
        InForce(HZ, *3 * [point.voltage_v], True),
        finger,
    )[0]
    assert gains.off * low_n + gains.rise * rise_n == pytest.approx(0.6 * LOAD_N, rel=WITHIN)


@pytest.mark.parametrize(
    ("effect", "value"),
    [
        ({"load_dependent_friction": {"exponent": 0.8}}, False),
        ({"series_resistance": {"resistance_ohm": 1e6}}, False),
        ({"contact_area_law": {"exponent": 0.4}}, True),
        ({}, True),
    ],
)
def test_area_counts_where_friction_depends_on_pressure_alone(touch, effect, value):
    assert by_pressure(with_hidden(touch, effect)) is value


def test_a_touch_that_spreads_under_load_is_looked_up_by_its_pressure(surface):
    """A = A_ref (N/0.5 N)^0.4 has the pressure p at N = (p A_ref/0.5^0.4)^(1/0.6)."""
    loads_n = np.exp(surface.log_normal_force)
    pressures_pa = loads_n / (USUAL_M2 * (loads_n / 0.5) ** 0.4)
    spreads = surface._replace(log_pressure=np.log(pressures_pa))
    pressure_pa = LOAD_N / 150e-6
    expected_n = (pressure_pa * USUAL_M2 / 0.5**0.4) ** (1.0 / 0.6)
    told = FINGER._replace(contact_area_m2=150e-6)
    assert as_solved(spreads, told).normal_force_n == pytest.approx(expected_n, rel=1e-6)


def test_a_tick_of_a_rig_looks_friction_up_for_the_area_that_comes_with_the_sample(
    rig_config, surface_file, touch
):
    settings = tick_settings(rig_config, surface_file, Uniform(0.6))
    area_m2 = 2.0 * USUAL_M2
    sample = FingerSample(1.0, 0.05, 0.03, LOAD_N, now_s=1.0, contact_area_m2=area_m2)
    _, done = tick(settings, TickState(), sample)
    drive = done.wanted.frequency_hz, done.wanted.voltage_v, LOAD_N
    conditions = Conditions(*map(np.atleast_1d, drive), contact_area_m2=np.array([area_m2]))
    assert touch.cof(conditions)[0] == pytest.approx(0.6, rel=WITHIN)
    _, without = tick(settings, TickState(), sample._replace(contact_area_m2=math.nan))
    assert abs(done.wanted.voltage_v - without.wanted.voltage_v) > 0.5


def test_a_finger_is_known_by_its_pressure(surface, limits):
    """2 N are the most that the surface has for its own area."""
    controller, heavy = made(surface, limits), FINGER._replace(normal_force_n=3.0)
    assert not controller.knows(heavy)
    assert controller.knows(heavy._replace(contact_area_m2=2.0 * USUAL_M2))
    assert not controller.knows(FINGER._replace(contact_area_m2=0.1 * USUAL_M2))
