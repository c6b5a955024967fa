"""Texture stage: values worked out by hand, scalar against array, bounds, tiling, interpolation."""

import math
import pickle

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptic_driver.errors import BadInputError
from haptic_driver.render.texture import (
    FrictionMap,
    Grating,
    Marker,
    Placed,
    Profile,
    Script,
    Step,
    Uniform,
    target,
)
from haptic_driver.signals import FingerState

# Bilinear and linear interpolation round a few times at values below 5: a few 1e-16, with room.
ROUNDING = 1e-12
# Arrays and single positions may round a tile's share differently: 1e-13 m of 1000 over 1e-4 m,
# times a step of 5.
TILED = 1e-8

cofs = st.floats(0.01, 5.0)
positions = st.floats(-0.3, 0.3)
lengths = st.floats(1e-4, 0.05)
ends = st.sampled_from(["nothing", "clamp", "tile"])


@st.composite
def maps(draw, outside=ends):
    rows, columns = draw(st.integers(1, 6)), draw(st.integers(1, 6))
    values = draw(st.lists(cofs, min_size=rows * columns, max_size=rows * columns))
    return FrictionMap(
        np.reshape(values, (rows, columns)), draw(lengths), draw(lengths), draw(outside)
    )


@st.composite
def profiles(draw):
    steps = draw(st.lists(st.floats(1e-4, 0.05), min_size=2, max_size=8))
    values = draw(st.lists(cofs, min_size=len(steps), max_size=len(steps)))
    return Profile(draw(positions) + np.cumsum(steps), values, draw(ends))


gratings = st.builds(
    Grating, cofs, st.floats(0.0, 0.5), lengths, st.floats(-7, 7), st.floats(-7, 7)
)
unplaced = st.one_of(st.builds(Uniform, cofs), gratings, profiles(), maps())
textures = st.one_of(unplaced, st.builds(Placed, unplaced, positions, positions, st.floats(-7, 7)))


@st.composite
def scripts(draw):
    times_s = np.cumsum(draw(st.lists(st.floats(1e-3, 5.0), min_size=2, max_size=5))).tolist()
    ways = st.sampled_from(["hold", "linear", "cosine"])
    steps = tuple(
        Step(t, draw(textures), draw(ways), draw(st.sampled_from(["", "a", "b"]))) for t in times_s
    )
    return Script(steps, draw(st.floats(-10, 10)))


@given(st.one_of(textures, scripts()), st.floats(), st.floats(), st.floats(), st.booleans())
def test_every_target_is_finite_and_within_bounds_or_none_wherever_and_whenever(
    asked, time_s, x_m, y_m, in_contact
):
    low, high = asked.bounds()
    answer = target(asked, FingerState(time_s, x_m, y_m, 0.0, 0.0, 0.5, in_contact))
    if answer.active:
        assert in_contact
        assert low - ROUNDING <= answer.cof <= high + ROUNDING
    else:
        assert math.isnan(answer.cof)


@given(
    textures,
    st.lists(st.tuples(st.floats(), st.floats()) | st.tuples(positions, positions), max_size=20),
)
def test_arrays_give_what_single_positions_give(texture, points):
    x_m, y_m = np.array(points, dtype=float).reshape(-1, 2).T
    together = texture.cof_at(x_m, y_m)
    one_by_one = [texture.cof_at(x, y) for x, y in points]
    assert together.shape == x_m.shape
    np.testing.assert_allclose(
        together, np.array(one_by_one, dtype=float), rtol=0, atol=TILED, equal_nan=True
    )


@pytest.mark.parametrize("nowhere", [math.nan, math.inf, -math.inf, 1e300])
def test_no_texture_asks_for_anything_off_every_screen(nowhere):
    tiled = FrictionMap(np.full((2, 2), 0.6), 1e-3, 1e-3, outside="tile")
    for texture in (Uniform(0.6), Grating(0.6, 0.1, 0.01), Profile([0, 1], [0.5, 0.6]), tiled):
        assert math.isnan(texture.cof_at(nowhere, 0.0))
        assert math.isnan(texture.cof_at(0.0, nowhere))
        assert np.isnan(texture.cof_at(np.array([nowhere]), np.array([0.0]))).all()


@pytest.mark.parametrize(
    ("x_m", "y_m", "direction_rad", "phase_rad", "cof"),
    [
        (0.0, 0.0, 0.0, 0.0, 0.6),
        (0.0025, 0.9, 0.0, 0.0, 0.7),  # a quarter period along x; y plays no part
        (0.0075, 0.0, 0.0, 0.0, 0.5),
        (0.9, 0.0025, math.pi / 2, 0.0, 0.7),  # turned to vary along y
        (0.0, 0.0, 0.0, math.pi / 2, 0.7),
        (0.0025 / math.sqrt(2), 0.0025 / math.sqrt(2), math.pi / 4, 0.0, 0.7),
    ],
)
def test_grating_has_its_crests_where_they_belong(x_m, y_m, direction_rad, phase_rad, cof):
    assert Grating(0.6, 0.1, 0.01, direction_rad, phase_rad).cof_at(x_m, y_m) == pytest.approx(
        cof, abs=1e-12
    )


def test_profile_is_linear_between_its_points_and_nothing_outside():
    profile = Profile([0.0, 0.01, 0.03], [0.5, 0.7, 0.6])
    x_m = np.array([-1e-9, 0.0, 0.005, 0.01, 0.02, 0.03, 0.03 + 1e-9])
    expected = [math.nan, 0.5, 0.6, 0.7, 0.65, 0.6, math.nan]
    np.testing.assert_allclose(profile.cof_at(x_m, np.zeros(7)), expected, atol=ROUNDING)
    np.testing.assert_allclose(
        [profile.cof_at(x, 5.0) for x in x_m.tolist()], expected, atol=ROUNDING
    )
    assert profile.bounds() == (0.5, 0.7)


def test_profile_clamped_and_tiled_beyond_its_ends():
    x_m = [-0.015, -0.005, 0.035, 0.055]
    clamped = Profile([0.0, 0.01, 0.03], [0.5, 0.7, 0.6], "clamp")
    assert [clamped.cof_at(x, 0.0) for x in x_m] == pytest.approx([0.5, 0.5, 0.6, 0.6])
    # 30 mm on is the same again: -15 is +15, -5 is +25, 35 is 5, 55 is 25
    tiled = Profile([0.0, 0.01, 0.03], [0.5, 0.7, 0.6], "tile")
    expected = [0.675, 0.625, 0.6, 0.625]
    assert [tiled.cof_at(x, 0.0) for x in x_m] == pytest.approx(expected)
    np.testing.assert_allclose(tiled.cof_at(np.array(x_m), np.zeros(4)), expected, atol=ROUNDING)


def test_placed_moves_first_and_turns_about_the_new_origin():
    # A quarter turn towards +y: what lay along +x of the texture lies along +y of the screen.
    placed = Placed(Profile([0.0, 0.01], [0.5, 0.7]), 0.1, 0.2, math.pi / 2)
    assert placed.cof_at(0.1, 0.205) == pytest.approx(0.6)
    assert placed.cof_at(0.9, 0.2075) == pytest.approx(0.65)
    assert math.isnan(placed.cof_at(0.1, 0.211))
    assert placed.bounds() == (0.5, 0.7)


def test_map_puts_rows_along_y_and_columns_along_x():
    picture = Placed(
        FrictionMap(np.array([[0.1, 0.2, 0.3], [0.4, 0.5, 0.6]]), pitch_x_m=0.01, pitch_y_m=0.02),
        0.1,
    )
    assert picture.cof_at(0.105, 0.01) == pytest.approx(0.1)  # centre of the first pixel
    assert picture.cof_at(0.125, 0.01) == pytest.approx(0.3)
    assert picture.cof_at(0.105, 0.03) == pytest.approx(0.4)
    assert picture.cof_at(0.110, 0.02) == pytest.approx(0.3)  # where four pixels meet: their mean
    assert picture.cof_at(0.101, 0.001) == pytest.approx(0.1)  # the outer half pixel holds the edge
    assert picture.bounds() == (0.1, 0.6)


def test_clamped_map_holds_its_nearest_edge():
    picture = FrictionMap(np.array([[0.1, 0.2], [0.3, 0.4]]), 0.01, 0.01, "clamp")
    corners = [
        picture.cof_at(x, y) for x, y in [(-0.5, -0.5), (0.5, -0.5), (-0.5, 0.5), (0.5, 0.5)]
    ]
    assert corners == pytest.approx([0.1, 0.2, 0.3, 0.4])
    assert picture.cof_at(0.01, 9.0) == pytest.approx(
        0.35
    )  # halfway between the pixels of the last row


def test_tiled_map_interpolates_across_its_seam():
    picture = FrictionMap(np.array([[0.2, 0.3, 0.6]]), 0.01, 0.01, "tile")
    assert picture.cof_at(0.0, 0.005) == pytest.approx(
        0.4
    )  # halfway from the last pixel to the first
    assert picture.cof_at(0.03, 0.005) == pytest.approx(0.4)
    assert picture.cof_at(-0.005, 0.005) == pytest.approx(0.6)


def test_interpolation_is_exact_on_a_plane(rng):
    x_m, y_m = 0.002 * (np.arange(7) + 0.5), 0.003 * (np.arange(5) + 0.5)
    picture = FrictionMap(2.0 + 4.0 * x_m[None, :] - 3.0 * y_m[:, None], 0.002, 0.003)
    at_x_m, at_y_m = rng.uniform(x_m[0], x_m[-1], 50), rng.uniform(y_m[0], y_m[-1], 50)
    wanted = 2.0 + 4.0 * at_x_m - 3.0 * at_y_m
    np.testing.assert_allclose(picture.cof_at(at_x_m, at_y_m), wanted, atol=1e-11)


def test_the_finest_detail_is_that_of_the_finest_part():
    grating, picture = Grating(0.6, 0.1, period_m=4e-3), FrictionMap(np.ones((2, 3)), 2e-3, 1e-3)
    profile = Profile([0.0, 3e-3, 3.5e-3], [0.6, 0.7, 0.6])
    assert [
        texture.detail_m for texture in (Uniform(0.6), grating, picture, profile)
    ] == pytest.approx([math.inf, 2e-3, 1e-3, 0.5e-3])
    assert Script((Step(0.0, grating), Step(1.0, Placed(picture)))).detail_m == 1e-3


def test_map_keeps_a_copy_that_nobody_can_change():
    values = np.full((2, 2), 0.6)
    picture = FrictionMap(values, 1e-3, 1e-3)
    values[:] = 9.0
    assert picture.cof_at(1e-3, 1e-3) == 0.6
    for kept in (picture, pickle.loads(pickle.dumps(picture))):
        with pytest.raises(ValueError, match="read-only"):
            kept.cof[0, 0] = 9.0


@pytest.mark.parametrize(
    "make",
    [
        lambda: Uniform(math.nan),
        lambda: Grating(0.6, 0.1, 0.0),
        lambda: Profile([0.0, 1.0], [0.6]),
        lambda: Profile([0.0, 0.0], [0.6, 0.6]),
        lambda: FrictionMap(np.full((2, 2), math.nan), 1e-3, 1e-3),
        lambda: Placed(Uniform(0.6), 0.0, 0.0, math.inf),
    ],
)
def test_textures_without_meaning_are_refused(make):
    with pytest.raises(BadInputError) as caught:
        make()
    assert caught.value.code == "bad_texture"
    assert caught.value.hint


def finger(x_m, in_contact=True, time_s=0.0):
    return FingerState(time_s, x_m, 0.0, 0.0, 0.0, 0.5, in_contact)


STEPS = (
    Step(1.0, Uniform(0.5), "hold", "go"),
    Step(2.0, Uniform(0.6), "linear"),
    Step(4.0, Uniform(0.8), "cosine", "top"),
    Step(5.0, Uniform(0.6), "hold", "end"),
)


@pytest.mark.parametrize(
    ("time_s", "cof"),
    [
        (0.999, None),
        (1.0, 0.5),
        (2.5, 0.65),
        (4.0, 0.8),
        (4.25, 0.7 + 0.1 * math.sqrt(0.5)),  # cosine from 0.8 to 0.6 about 0.7
        (4.999999, 0.6),
        (5.0, None),
        (math.nan, None),
    ],
)
@pytest.mark.parametrize("start_s", [0.0, 1000.0])
def test_script_holds_and_fades_by_the_clock(time_s, cof, start_s):
    answer = target(Script(STEPS).started(start_s), finger(0.0, time_s=start_s + time_s))
    assert answer.active is (cof is not None)
    if cof is not None:
        assert answer.cof == pytest.approx(cof, abs=1e-9)


@pytest.mark.parametrize(
    ("time_s", "ahead_s", "cof"),
    [
        (1.9, [0.05, 0.2], [0.5, 0.5]),  # a jump waits
        (2.5, [0.0, 0.5], [0.65, 0.7]),
        (3.75, [0.0, 0.25, 0.5, 0.75], [0.775, 0.8, 0.7 + 0.1 * math.sqrt(0.5), 0.7]),
        (4.5, [0.0, 0.5, 1.0], [0.7, 0.6, 0.6]),  # so does the end
        (0.9, [0.0, 0.2], [math.nan, math.nan]),
    ],
)
@pytest.mark.parametrize("start_s", [0.0, 1000.0])
def test_script_goes_on_while_it_fades_until_something_jumps(time_s, ahead_s, cof, start_s):
    script = Script(STEPS).started(start_s)
    along = script.cof_along(finger(0.0, time_s=start_s + time_s), np.array(ahead_s))
    np.testing.assert_allclose(along, cof, atol=1e-9)


def test_script_fades_between_textures_under_the_finger():
    ramp = Profile([0.0, 0.1], [0.5, 0.7])
    script = Script((Step(0.0, ramp, "linear"), Step(1.0, Uniform(0.8)), Step(2.0, ramp)))
    assert target(script, finger(0.05, time_s=0.5)).cof == pytest.approx(0.7)  # between 0.6 and 0.8
    assert target(script, finger(0.1, time_s=0.5)).cof == pytest.approx(0.75)
    assert not target(script, finger(0.2, time_s=0.5)).active  # half of a texture that is not there
    assert target(script, finger(0.2, time_s=1.5)).cof == pytest.approx(0.8)
    assert script.bounds() == (0.5, 0.8)


def test_script_gives_every_marker_once_at_its_own_time():
    script = Script(STEPS).started(100.0)
    assert script.end_s == 105.0
    assert script.markers(-math.inf, 105.0) == (
        Marker(101.0, "go"),
        Marker(104.0, "top"),
        Marker(105.0, "end"),
    )
    assert script.markers(101.0, 104.0) == (Marker(104.0, "top"),)
    assert script.markers(100.9, 100.999) == ()


@pytest.mark.parametrize("steps", [(), STEPS[::-1], (Step(math.nan, Uniform(0.6)), STEPS[0])])
def test_scripts_without_meaning_are_refused(steps):
    with pytest.raises(BadInputError) as caught:
        Script(steps)
    assert caught.value.hint
