"""Scenes: areas by geometry, order, edges, and textures that move with their objects."""

import math
import pickle

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image, ImageDraw

from haptic_driver.errors import BadInputError
from haptic_driver.render.scene import materials_of
from haptic_driver.render.texture import FrictionMap, Grating, Placed, Profile, Uniform, Waves
from haptic_driver.signals import FingerState
from haptic_driver.textures.objects import SceneDescription
from haptic_driver.textures.scene import Live, Material, drawn, read_outline

STEP_MM = 0.05
# An outline of length L passes L / STEP_MM cells, each counted or not by its middle: off by half a
# cell each at worst, and the signs of neighbours differ.
CELLS_OFF = 0.5


def scene_of(objects, textures=None, background=None):
    given_textures = textures or {}
    described = SceneDescription.model_validate(
        {"background": background or {}, "object": [dict(each) for each in objects]}
    )
    return drawn(described, lambda material: given_textures[material.name])


def thing(shape, at=(30.0, 20.0), **more):
    made = {} if "texture" in more else {"cof": 0.8}
    return {"id": "a", "shape": shape, "origin_mm": list(at), **made, **more}


def covered_mm2(scene):
    """The area where friction is asked for, cell by cell."""
    x_m = 1e-3 * STEP_MM * (np.arange(1200) + 0.5)
    asked = np.isfinite(scene.cof_at(x_m[None, :], x_m[:800, None]))
    return STEP_MM**2 * asked.sum()


@pytest.mark.parametrize("turned", [0.0, 33.0])
@pytest.mark.parametrize(
    ("shape", "area_mm2", "length_mm"),
    [
        ({"kind": "rectangle", "width_mm": 12.0, "height_mm": 5.0}, 60.0, 34.0),
        (
            {"kind": "rectangle", "width_mm": 12.0, "height_mm": 5.0, "radius_mm": 2.0},
            60.0 - (4.0 - math.pi) * 4.0,
            34.0,
        ),
        ({"kind": "circle", "radius_mm": 6.0}, math.pi * 36.0, 38.0),
        ({"kind": "ellipse", "width_mm": 14.0, "height_mm": 6.0}, math.pi * 21.0, 33.0),
        ({"kind": "polygon", "corners_mm": [[-5, 0], [5, 0], [5, 8]]}, 40.0, 31.0),
        ({"kind": "polygon", "corners_mm": [[0, 0], [6, 0], [6, 6], [3, 2], [0, 6]]}, 24.0, 30.0),
    ],
)
def test_a_shape_covers_its_area(shape, area_mm2, length_mm, turned):
    scene = scene_of([thing(shape, rotation_deg=turned)]).scene()
    assert covered_mm2(scene) == pytest.approx(area_mm2, abs=CELLS_OFF * length_mm * STEP_MM)


def test_a_mask_covers_what_its_picture_shows(tmp_path):
    picture = Image.new("LA", (200, 100), (255, 0))
    ImageDraw.Draw(picture).ellipse((40, 20, 139, 79), fill=(0, 255))
    picture.save(tmp_path / "oval.png")
    outline = read_outline(tmp_path / "oval.png", 20.0)
    shape = {"kind": "mask", "file": "oval.png", "width_mm": 20.0}
    scene = scene_of([thing(shape, rotation_deg=20.0)], {"oval.png": outline}).scene()
    # 100 by 60 pixels of 0.1 mm; a pixel of the picture is as much as two cells.
    assert covered_mm2(scene) == pytest.approx(math.pi * 5.0 * 3.0, abs=26.0 * 0.1 * CELLS_OFF)
    assert np.isfinite(scene.cof_at(0.030 - 0.001, 0.020))  # its middle is the place


@given(
    st.floats(-180.0, 180.0), st.floats(5.0, 50.0), st.floats(5.0, 35.0), st.integers(0, 2**32 - 1)
)
@settings(max_examples=30, deadline=None)
def test_a_texture_moves_and_turns_with_its_object(angle_deg, x_mm, y_mm, seed):
    """Against the texture itself, asked at places taken back by a matrix made here."""
    rng = np.random.default_rng(seed)
    textures = {
        "grating": Grating(0.7, 0.1, 0.004, 0.4, 0.3),
        "map": FrictionMap(rng.uniform(0.5, 0.9, (9, 7)), 0.002, 0.0015, "tile"),
        "profile": Placed(Profile((0.0, 0.002, 0.005), (0.6, 0.8, 0.7), "tile"), 0.001, 0.0, 0.5),
        "waves": Waves(
            rng.uniform(0.5, 0.9, (2, 2, 16)),
            np.array([0.02, 0.1]),
            np.array([0.3, 0.9]),
            0.008,
            0.6,
            (0.05, 0.5),
        ),
    }
    turned = np.deg2rad(angle_deg)
    back = np.array([[np.cos(turned), np.sin(turned)], [-np.sin(turned), np.cos(turned)]])
    places = 1e-3 * (np.array([[x_mm], [y_mm]]) + rng.uniform(-4.0, 4.0, (2, 50)))
    own = back @ (places - 1e-3 * np.array([[x_mm], [y_mm]]))
    shape = {"kind": "circle", "radius_mm": 6.0}
    whole = scene_of([thing(shape, (1.0, 1.0), texture=n, id=n) for n in textures], textures)
    for name, texture in textures.items():
        live = whole.changed(
            SceneDescription.model_validate(
                {
                    "object": [
                        thing(shape, (x_mm, y_mm), texture=name, rotation_deg=angle_deg, id=name)
                    ]
                }
            )
        )
        felt = live.scene().cof_at(*places)
        # Places rounded by 1e-18 m, times the steepest slope, 0.4 in 1.5 mm.
        np.testing.assert_allclose(felt, texture.cof_at(*own), rtol=0.0, atol=1e-9)


def test_speed_and_load_of_the_finger_are_those_of_its_texture():
    waves = Waves(
        np.arange(16.0).reshape(2, 2, 4) / 40.0 + 0.5,
        np.array([0.02, 0.1]),
        np.array([0.3, 0.9]),
        0.008,
        0.0,
        (0.05, 0.5),
    )
    scene = scene_of(
        [thing({"kind": "circle", "radius_mm": 9.0}, (0.0, 0.0), texture="w")], {"w": waves}
    ).scene()
    for speed_m_s, load_n in ((0.02, 0.3), (0.07, 0.8)):
        finger = FingerState(0.0, 0.003, 0.001, speed_m_s, 0.0, load_n, True)
        assert scene.cof_under(finger) == pytest.approx(waves.cof_under(finger), abs=1e-12)
        ahead_s = np.linspace(0.0, 0.001, 20)
        np.testing.assert_allclose(
            scene.cof_along(finger, ahead_s), waves.cof_along(finger, ahead_s), atol=1e-12
        )


def test_the_highest_order_lies_on_top_and_of_equals_the_last():
    box = {"kind": "rectangle", "width_mm": 10.0, "height_mm": 10.0}
    low = thing(box, cof=0.6, id="low", order=1)
    high = thing(box, cof=0.7, id="high", order=2)
    again = thing(box, cof=0.8, id="again", order=1)
    assert scene_of([high, low, again]).scene().cof_at(0.03, 0.02) == 0.7
    assert scene_of([low, again]).scene().cof_at(0.03, 0.02) == 0.8
    assert scene_of([low, again | {"enabled": False}]).scene().cof_at(0.03, 0.02) == 0.6


def test_a_soft_edge_goes_straight_into_what_is_below():
    box = {"kind": "rectangle", "width_mm": 20.0, "height_mm": 20.0}
    scene = scene_of([thing(box, soft_edge_mm=4.0)], background={"cof": 0.6}).scene()
    x_m = 1e-3 * np.array([36.0, 38.0, 39.0, 40.0, 41.0, 42.0, 44.0])  # the side is at 40 mm
    wanted = [0.8, 0.8, 0.75, 0.7, 0.65, 0.6, 0.6]
    np.testing.assert_allclose(scene.cof_at(x_m, np.full(7, 0.02)), wanted, atol=1e-12)


def test_towards_nothing_an_edge_ends_in_its_middle():
    box = {"kind": "rectangle", "width_mm": 20.0, "height_mm": 20.0}
    scene = scene_of([thing(box, soft_edge_mm=4.0)]).scene()
    assert scene.cof_at(0.0399, 0.02) == pytest.approx(0.8)
    assert math.isnan(scene.cof_at(0.0401, 0.02))


SQUARE = {"kind": "rectangle", "width_mm": 20.0, "height_mm": 20.0}
QUARTERS = FrictionMap(np.array([[0.3, 0.5], [0.7, 0.9]]), 0.004, 0.002, "nothing")
RAMP = Profile([0.001, 0.003], [0.3, 0.5], "nothing")


@pytest.mark.parametrize("textured", [QUARTERS, Placed(QUARTERS, 0.1, 0.2), RAMP])
@pytest.mark.parametrize(
    "shape",
    [
        SQUARE,
        {"kind": "ellipse", "width_mm": 8.0, "height_mm": 18.0},
        {"kind": "polygon", "corners_mm": [[-2, 1], [9, 1], [9, 8]]},
    ],
)
@pytest.mark.parametrize("fit", ["cover", "tile"])
def test_a_map_or_profile_leaves_no_part_of_an_object_empty(textured, shape, fit):
    """A photo on a square once covered a quarter of it, and a profile a half."""
    scene = scene_of([thing(shape, texture="t", fit=fit, rotation_deg=20.0)], {"t": textured})
    plain = scene_of([thing(shape, rotation_deg=20.0)])
    assert covered_mm2(scene.scene()) == covered_mm2(plain.scene()) > 0.0


def test_a_map_that_covers_keeps_its_middle_and_its_proportions():
    """2 by 2 pixels of 4 by 2 mm, on 20 by 20 mm: five times as large, and cut at both sides."""
    asked = scene_of([thing(SQUARE, texture="t")], {"t": QUARTERS}).scene()
    assert asked.cof_at(0.030, 0.020) == pytest.approx(0.6)
    assert asked.cof_at(0.030 - 0.0099, 0.020 - 0.0099) == pytest.approx(0.301, abs=1e-3)
    assert asked.cof_at(0.030, 0.020 + 0.005) == pytest.approx(0.8)


def test_a_profile_that_covers_runs_from_side_to_side():
    asked = scene_of([thing(SQUARE, texture="t")], {"t": RAMP}).scene()
    assert asked.cof_at(0.0201, 0.012) == pytest.approx(0.301)
    assert asked.cof_at(0.0399, 0.028) == pytest.approx(0.499)


def test_a_tiled_map_begins_at_the_corner():
    asked = scene_of([thing(SQUARE, texture="t", fit="tile")], {"t": QUARTERS}).scene()
    assert asked.cof_at(0.022, 0.011) == pytest.approx(0.3)
    assert asked.cof_at(0.022 + 0.008, 0.011 + 0.004) == pytest.approx(0.3)


def test_what_a_texture_does_not_say_shows_what_is_below():
    hole = FrictionMap(np.full((2, 2), 0.9), 0.001, 0.001, "nothing")  # 2 mm of a 10 mm circle
    disc = thing({"kind": "circle", "radius_mm": 5.0}, texture="hole", fit="place")
    scene = scene_of([disc], {"hole": hole}, {"cof": 0.6}).scene()
    assert scene.cof_at(0.031, 0.021) == 0.9
    assert scene.cof_at(0.027, 0.020) == 0.6


def test_bounds_and_detail_are_those_of_what_is_there():
    grating = Grating(0.7, 0.1, 0.004)
    disc = thing({"kind": "circle", "radius_mm": 5.0}, texture="g", soft_edge_mm=5.0)
    scene = scene_of([disc], {"g": grating}, {"cof": 0.55}).scene()
    assert scene.bounds() == (0.55, 0.7 + 0.1)
    assert scene.detail_m == 0.002  # from ridge to groove
    empty = scene_of([]).scene()
    assert math.isnan(empty.bounds()[0])
    assert math.isnan(empty.cof_at(0.01, 0.01))


def test_one_place_and_many_and_a_pickle_say_the_same():
    rng = np.random.default_rng(3)
    things = [
        thing(
            {"kind": "circle", "radius_mm": 3.0},
            rng.uniform(0.0, 60.0, 2).tolist(),
            id=str(k),
            cof=0.5 + 0.001 * k,
            soft_edge_mm=1.0,
        )
        for k in range(100)
    ]
    scene = scene_of(things, background={"cof": 0.5}).scene()
    other = pickle.loads(pickle.dumps(scene, protocol=5))
    x_m, y_m = rng.uniform(0.0, 0.06, (2, 200))
    many = scene.cof_at(x_m, y_m)  # few enough places at once to leave objects out:
    few = np.concatenate(
        [scene.cof_at(x_m[k : k + 20], y_m[k : k + 20]) for k in range(0, 200, 20)]
    )
    single = [other.cof_at(float(x), float(y)) for x, y in zip(x_m, y_m, strict=True)]
    np.testing.assert_array_equal(many, single)
    np.testing.assert_array_equal(many, few)


def test_a_scene_in_a_scene_is_refused():
    with pytest.raises(BadInputError, match="a scene itself") as refused:
        materials_of([scene_of([]).scene()])
    assert refused.value.code == "nested_scene"


def test_a_moved_scene_is_the_scene_made_anew():
    from haptic_driver.daemon.verbs import SceneChange

    box = {"kind": "rectangle", "width_mm": 6.0, "height_mm": 4.0}
    start = scene_of(
        [thing(box, id="a", order=1), thing(box, id="b", texture="u")], {"u": Uniform(0.6)}
    )
    changes = SceneChange.model_validate(
        {
            "changes": [
                {"do": "move", "id": "a", "x_mm": 10.0, "y_mm": 12.0},
                {"do": "turn", "id": "b", "rotation_deg": 30.0},
                {"do": "move", "id": "a", "x_mm": 11.0, "y_mm": 12.5},
            ]
        }
    ).changes
    moved = Live(start).moved(changes, (0.1, 0.06))
    anew = start.changed(start.described.changed(changes))
    assert moved.drawn.described == anew.described
    np.testing.assert_array_equal(moved.objects.rows, anew.objects().rows)
    assert moved.drawn.described.object[0].origin_mm == [11.0, 12.5]
    assert list(moved.drawn.materials) == [Material("u")]
