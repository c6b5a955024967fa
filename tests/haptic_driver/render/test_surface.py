"""Look-up and inversion of the surface against scipy, numpy and the model itself."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import RegularGridInterpolator

from haptic_driver.limits import OperatingLimits
from haptic_driver.lookup.file import ready_for_lookup
from haptic_driver.render.surface import NO_CAPS, Caps, cof_at, invert
from model.conditions import Conditions

ROUNDING = 1e-12  # of a few sums of numbers near 1
SURFACE_ERROR = 2e-3  # the surface's promise, of friction
INVERSION_ERROR = 1e-3  # the inversion's promise, of friction
WIDE = OperatingLimits(
    voltage_v=1e3, frequency_low_hz=1e-3, frequency_high_hz=1e9, contact_current_a_rms=((1.0, 1e3),)
)


def random_points(rng, count):
    """Anywhere on the default surface: 1 Hz to 1 MHz, 0 to 150 V, 0.1 to 2 N."""
    frequency_hz = 10.0 ** rng.uniform(0.0, 6.0, count)
    return frequency_hz, rng.uniform(0.0, 150.0, count), 0.1 * 20.0 ** rng.uniform(0.0, 1.0, count)


def looked_up(surface, *points):
    """Friction at n points, one by one."""
    return np.array(
        [cof_at(surface, *point) for point in zip(*(x.tolist() for x in points), strict=True)]
    )


@pytest.fixture(scope="module")
def scipy_cof(surface, grid):
    axes = (np.log(grid.frequency_hz), np.log(grid.normal_force_n), grid.voltage_v)
    interpolate = RegularGridInterpolator(axes, surface.cof)
    return lambda f, v, n: interpolate(np.column_stack([np.log(f), np.log(n), v]))


def test_look_up_agrees_with_scipy_at_random_points(surface, scipy_cof, rng):
    points = random_points(rng, 3_000)
    found = looked_up(surface, *points)
    np.testing.assert_allclose(found, scipy_cof(*points), rtol=0.0, atol=ROUNDING)


@pytest.mark.parametrize(
    ("outside", "edge"),
    [
        ((1e-3, 70.0, 0.4), (1.0, 70.0, 0.4)),
        ((5e7, -20.0, 0.4), (1e6, 0.0, 0.4)),
        ((300.0, 900.0, 1e-3), (300.0, 150.0, 0.1)),
        ((300.0, 70.0, 40.0), (300.0, 70.0, 2.0)),
    ],
)
def test_outside_the_surface_its_edge_holds(surface, scipy_cof, outside, edge):
    expected = scipy_cof(*(np.array([x]) for x in edge))[0]
    assert cof_at(surface, *outside) == pytest.approx(
        expected, abs=1e-9
    )  # the edge through a logarithm and back


@pytest.mark.parametrize("which", [0, 1, 2])
def test_nan_in_gives_nan_out(surface, which):
    point = [300.0, 70.0, 0.4]
    point[which] = math.nan
    assert math.isnan(cof_at(surface, *point))


def test_surface_follows_the_model_everywhere(surface, touch, rng):
    f, v, n = random_points(rng, 40_000)
    model_cof = touch.predict(Conditions(f, v, n)).cof
    assert np.isfinite(model_cof).all()
    assert np.max(np.abs(looked_up(surface, f, v, n) / model_cof - 1.0)) <= SURFACE_ERROR


def test_inversion_returns_the_target_on_surface_and_model(surface, touch, rng):
    frequency, _, force = random_points(rng, 4_000)
    share = rng.uniform(0.0, 1.0, 4_000)
    solved = []
    for f, n, s in zip(frequency.tolist(), force.tolist(), share.tolist(), strict=True):
        reach = invert(surface, math.inf, f, n, NO_CAPS)
        target = reach.cof_low + s * (reach.cof_high - reach.cof_low)
        found = invert(surface, target, f, n, NO_CAPS)
        assert found.cof == pytest.approx(target, abs=1e-6)
        assert cof_at(surface, f, found.voltage_v, n) == pytest.approx(target, abs=1e-6)
        assert 0.0 <= found.voltage_v <= 150.0
        solved.append((f, found.voltage_v, n, target))
    f, v, n, target = np.array(solved).T
    assert np.ptp(target) > 0.5  # else the draw has missed what matters
    model_cof = touch.predict(Conditions(f, v, n)).cof
    assert np.max(np.abs(model_cof / target - 1.0)) <= INVERSION_ERROR


@pytest.mark.parametrize("target", [-1.0, 0.0, 0.3, 0.512])
def test_targets_below_the_reachable_give_zero_volts(surface, target):
    found = invert(surface, target, 250.0, 0.5, NO_CAPS)
    assert found.voltage_v == 0.0
    assert (
        found.cof == found.cof_low == pytest.approx(0.512, abs=ROUNDING)
    )  # friction without voltage
    assert found.current_rms_a == 0.0
    assert found.stuck_current_rms_a == 0.0


def test_currents_of_an_inversion_are_those_of_the_model(surface, touch):
    found = invert(surface, 0.65, 137.0, 0.7, NO_CAPS)
    answer = touch.predict(Conditions(*(np.array([x]) for x in (137.0, found.voltage_v, 0.7))))
    # linear between nodes 7 % apart in frequency: 0.5 % of a current that rises a little slower
    # than frequency
    assert found.current_rms_a == pytest.approx(answer.current_rms_a[0], rel=5e-3)
    assert found.stuck_current_rms_a == pytest.approx(answer.stuck_current_rms_a[0], rel=5e-3)


@pytest.mark.parametrize("frequency_hz", [137.0, 3e3])
def test_caps_hold_and_are_made_use_of(surface, frequency_hz):
    """Half of what limits allow, by voltage and by current; current grows with voltage."""
    free = invert(surface, math.inf, frequency_hz, 0.5, NO_CAPS)
    by_voltage = invert(surface, math.inf, frequency_hz, 0.5, Caps(0.5 * free.voltage_v, math.inf))
    assert by_voltage.voltage_v == 0.5 * free.voltage_v
    assert (
        by_voltage.cof
        == by_voltage.cof_high
        == cof_at(surface, frequency_hz, by_voltage.voltage_v, 0.5)
    )
    cap = Caps(math.inf, 0.5 * free.current_rms_a)
    by_current = invert(surface, math.inf, frequency_hz, 0.5, cap)
    assert by_current.current_rms_a <= cap.current_a
    assert by_current.current_rms_a == pytest.approx(cap.current_a, rel=1e-8)
    below = invert(surface, 0.5 * (by_current.cof + by_current.cof_low), frequency_hz, 0.5, cap)
    assert 0.0 < below.voltage_v < by_current.voltage_v


def test_a_node_has_its_own_limit(surface, surface_file):
    """The frequency of a node goes through a logarithm: rounding must not bring the neighbour's
    limit in.
    """
    f = surface_file.frequency_hz
    per_volt = surface_file.stuck_current_rms_a[:, -1] / 150.0
    curve = np.interp(
        np.log(f), np.log([2.5e3, 100e3]), np.log([0.5e-3, 20e-3])
    )  # ICNIRP 2010, general public
    own_v = np.minimum(150.0, np.exp(curve) / per_volt)
    used_v = np.array([invert(surface, math.inf, float(x), 0.5, NO_CAPS).voltage_v for x in f])
    # 1 % leaves room for any margin below the limit; the neighbour's is up to 8 % lower
    np.testing.assert_allclose(used_v, own_v, rtol=1e-2)


FORBIDDEN = st.lists(st.booleans(), min_size=4 * 6 * 4, max_size=4 * 6 * 4)
# In cells; on a node, or clearly off it: within 1e-8 the look-up takes it for the node.
PLACE = st.one_of(
    st.integers(0, 3).map(float), st.floats(0.0, 3.0).filter(lambda x: abs(x - round(x)) > 1e-8)
)


@given(
    forbidden=FORBIDDEN, x=PLACE, y=PLACE, target=st.one_of(st.floats(0.5, 2.0), st.just(math.inf))
)
def test_nothing_at_or_beyond_a_forbidden_node_is_offered(make_file, forbidden, x, y, target):
    """Between an allowed and a forbidden node nothing is allowed either: the lower limit of the two
    holds.
    """
    voltage = np.linspace(0.0, 100.0, 6)
    sound = ~np.array(forbidden).reshape(4, 6, 4)
    sound[:, 0] = True
    file = make_file(
        np.geomspace(10.0, 1e4, 4), np.geomspace(0.1, 2.0, 4), voltage, within_theory=sound
    )
    around_x, around_y = {math.floor(x), math.ceil(x)}, {math.floor(y), math.ceil(y)}
    allowed_v = min(
        voltage[next((k for k in range(6) if not sound[i, k, j]), 6) - 1]
        for i in around_x
        for j in around_y
    )
    frequency_hz, force_n = float(10.0 ** (1.0 + x)), float(0.1 * 20.0 ** (y / 3.0))
    found = invert(ready_for_lookup(file, WIDE), target, frequency_hz, force_n, NO_CAPS)
    assert found.voltage_v <= allowed_v * (1.0 + 1e-12)
