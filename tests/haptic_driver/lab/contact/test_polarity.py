"""Contact that is bright, in a negative or by light that leaves the glass where it is touched; and
what such films cannot tell.
"""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.ndimage import gaussian_filter

from haptic_driver.errors import BadInputError
from haptic_driver.lab.contact.film import read_film
from haptic_driver.lab.contact.judge import GLARE, watch
from haptic_driver.lab.contact.scale import scale_from_ruler
from hw.camera.fingerprint import Optics, Touch, drawn
from tests.haptic_driver.lab.refusal import refused

tifffile = pytest.importorskip("tifffile")
pytest.importorskip("skimage")
OPTICS = Optics(width=230, height=290, scale_m=50e-6, blur_m=15e-6)
# what the method is good to
AREA_WITHIN = 0.03


@settings(max_examples=6, deadline=None)
@given(
    area_m2=st.floats(3e-5, 7e-5),
    seed=st.integers(0, 2**16),
    light=st.floats(0.5, 0.95),
    negative=st.booleans(),
)
def test_polarity_is_guessed_and_the_area_is_the_same(area_m2, seed, light, negative):
    optics = Optics(**(OPTICS.__dict__ | {"light": light}))
    made = drawn(Touch(area_m2), optics, np.random.default_rng(seed))
    frame = made.image / 255.0
    frames = [1.0 - frame if negative else frame]
    watched = watch(lambda: frames, np.zeros(1), OPTICS.scale_m)
    assert watched.contact == ("bright" if negative else "dark")
    assert watched.found[0].area_m2 == pytest.approx(made.area_m2, rel=AREA_WITHIN)
    assert any(watched.contact in words for words in watched.said)


def disc(radius_px: float, shape: tuple[int, int], centre: tuple[float, float]) -> np.ndarray:
    y, x = np.mgrid[: shape[0], : shape[1]]
    return (np.hypot(y - centre[0], x - centre[1]) < radius_px).astype(float)


def test_bright_discs_at_coarse_pixels_have_areas_and_no_ridges():
    """Frustrated total reflection at 0.6 mm a pixel: black glass, white touches."""
    frame = disc(12.0, (120, 200), (60.0, 50.0)) + disc(7.0, (120, 200), (60.0, 140.0))
    watched = watch(lambda: [frame], np.zeros(1), 0.6e-3)
    assert watched.contact == "bright"
    (found,) = watched.found
    # pixels are counted, of a circle of 75: half of a pixel on either side
    assert found.area_m2 == pytest.approx(np.pi * (12 * 0.6e-3) ** 2, rel=0.04)
    assert np.isnan(found.ridge_area_m2)
    assert any("has 2 touches" in words for words in watched.said)
    assert any("too coarse for ridges" in words for words in watched.said)


@pytest.mark.parametrize("bits", [8, 12, 16])
def test_glare_of_a_sensor_with_fewer_bits_is_seen(tmp_path, bits):
    counts = drawn(Touch(5e-5), OPTICS, np.random.default_rng(3)).image.astype(float)
    counts[140:150, 110:120] = 255.0
    stored = np.rint(counts / 255.0 * (2**bits - 1)).astype("u1" if bits == 8 else "u2")
    tifffile.imwrite(tmp_path / "a.tif", stored, photometric="minisblack")
    film = read_film(tmp_path / "a.tif")
    (found,) = watch(film.frames, film.time_s, OPTICS.scale_m).found
    assert found.bad == GLARE


@pytest.mark.parametrize("clipped_at", [0.9, 37.0])
def test_glare_of_floats_is_where_the_brightest_value_is_shared(tmp_path, clipped_at):
    bare = drawn(Touch(5e-5), OPTICS, np.random.default_rng(3)).image / 255.0
    glaring = bare.copy()
    glaring[140:150, 110:120] = 1.2
    stored = (clipped_at * np.stack([bare, glaring])).astype("f4")
    tifffile.imwrite(tmp_path / "a.tif", stored, photometric="minisblack")
    film = read_film(tmp_path / "a.tif")
    found = watch(film.frames, film.time_s, OPTICS.scale_m).found
    assert [one.bad == GLARE for one in found] == [False, True]


def test_three_frames_saved_as_one_colour_picture_are_refused(tmp_path):
    tifffile.imwrite(tmp_path / "a.tif", np.zeros((3, 80, 90), "u1"), photometric="rgb")
    with refused("one_picture", "planes of colour"):
        read_film(tmp_path / "a.tif")


def test_frames_of_two_depths_are_refused(tmp_path):
    tifffile.imwrite(tmp_path / "1.tif", np.full((80, 90), 900, "u2"))
    tifffile.imwrite(tmp_path / "2.tif", np.full((80, 90), 90, "u1"))
    with pytest.raises(BadInputError, match="another depth"):
        read_film(tmp_path)


def pattern(kind: str, side_px: float, tilt: float) -> np.ndarray:
    """As a lens shows it: edges lie between pixels too."""
    y, x = np.mgrid[:900, :1200] / 3.0
    u, v = x * np.cos(tilt) + y * np.sin(tilt), y * np.cos(tilt) - x * np.sin(tilt)
    if kind == "checkerboard":
        shown = (np.floor(u / side_px) + np.floor(v / side_px)) % 2
    else:
        shown = 1.0 * ((u / side_px % 1.0 < 0.15) | (v / side_px % 1.0 < 0.15))
    seen = gaussian_filter(shown, 2.4)[1::3, 1::3]
    noise = np.random.default_rng(1).normal(0.0, 0.03, seen.shape)
    return np.clip(0.2 + 0.6 * seen + noise, 0.0, 1.0)


@settings(max_examples=8, deadline=None)
@given(
    kind=st.sampled_from(("checkerboard", "grid")),
    side_px=st.floats(12.0, 40.0),
    tilt=st.floats(-0.7, 0.7),
)
def test_squares_and_grids_give_the_scale(tmp_path_factory, kind, side_px, tilt):
    """A checkerboard's strongest wave is longer than its squares by the square root of two."""
    path = tmp_path_factory.mktemp("ruler") / "ruler.tif"
    tifffile.imwrite(path, np.rint(255 * pattern(kind, side_px, tilt)).astype("u1"))
    found, said = scale_from_ruler(path, 0.5)
    # a fiftieth of a square over the picture
    assert found == pytest.approx(0.5 / side_px, rel=2e-3)
    assert ("checkerboard" in said) == (kind == "checkerboard")


def test_two_rulers_across_each_other_are_named(tmp_path):
    y, x = np.mgrid[:300, :400]
    lines = ((x / 21.0) % 1.0 < 0.2) | ((y / 33.0) % 1.0 < 0.2)
    tifffile.imwrite(tmp_path / "a.tif", np.where(lines, 40, 200).astype("u1"))
    with pytest.raises(BadInputError, match=r"directions, 3\S+ and 21\S* pixels apart"):
        scale_from_ruler(tmp_path / "a.tif", 1.0)
