"""Pictures of any kind as friction: what is read, stretched and mapped, and what is said of it."""

import math
import tomllib

import numpy as np
import pytest
from PIL import Image

from haptic_driver.errors import BadInputError
from haptic_driver.lab.importers.image import Picture, friction_shares, read_picture, rendered
from haptic_driver.textures.bands import Output
from haptic_driver.textures.library import load_texture
from tests.haptic_driver.commands import said_by

ALL = (0.0, 100.0)
LEFT, RIGHT = 50, 200  # of 255


def halves(mode="L"):
    grey = np.full((40, 60), LEFT, np.uint8)
    grey[:, 30:] = RIGHT
    return Image.fromarray(grey).convert(mode)


def turned(path):
    """Upright only as its EXIF orientation says: stored with its left side up."""
    stored = halves("RGB").transpose(Image.Transpose.ROTATE_90)
    about = stored.getexif()
    about[0x0112] = 6
    stored.save(path, exif=about, quality=95)


def transparent(path):
    """Left half of grey, right half of nothing, which shows as white."""
    picture = halves("RGBA")
    alpha = Image.new("L", (60, 40), 255)
    alpha.paste(0, (30, 0, 60, 40))
    picture.putalpha(alpha)
    picture.save(path)


def test_what_is_transparent_shows_as_white(tmp_path):
    transparent(tmp_path / "a.png")
    picture = read_picture(tmp_path / "a.png", 30.0)
    assert picture.pitch_mm * picture.bright.shape[1] == pytest.approx(30.0)
    ends = picture.bright[:, 3].mean(), picture.bright[:, -3].mean()
    assert ends == pytest.approx((LEFT / 255, 1.0), abs=1 / 255)


def test_a_large_photograph_is_averaged_to_what_is_felt(tmp_path):
    fine = np.tile(np.array([[0, 255]], np.uint8), (1200, 600))  # stripes of a pixel
    Image.fromarray(fine).save(tmp_path / "a.png")
    read = read_picture(tmp_path / "a.png", 60.0)
    assert read.pitch_mm == pytest.approx(0.1)
    np.testing.assert_allclose(read.bright, 0.5, atol=1e-6)


def bright(values, pitch_mm=0.5):
    return Picture(np.asarray(values, float), pitch_mm, [])


def test_luminance_is_stretched_between_percentiles():
    ramp = np.linspace(0.3, 0.5, 201)[None, :]
    shares = friction_shares(bright(ramp), "luminance", 0.0, (10.0, 90.0)).shares
    wanted = np.clip((ramp - 0.32) / 0.16, 0.0, 1.0)  # percentiles of a ramp
    np.testing.assert_allclose(shares, wanted, atol=1e-12)


@pytest.mark.parametrize("angle_deg", [0.0, 90.0, 30.0])
def test_height_is_the_slope_along_the_stroke(angle_deg):
    """A wave of height sin is friction cos; along the wave's crests it is flat."""
    y_mm, x_mm = 0.1 * np.mgrid[0:400, 0:400]
    angle = math.radians(angle_deg)
    along_mm = x_mm * math.cos(angle) + y_mm * math.sin(angle)
    wave = 0.5 + 0.4 * np.sin(math.tau * along_mm / 10.0)
    shares, *_, said = friction_shares(bright(wave, 0.1), "height", angle_deg, ALL)
    wanted = 0.5 + 0.5 * np.cos(math.tau * along_mm / 10.0)
    inside = (slice(20, -20),) * 2  # at a border the smoothing has one side only
    # The top 2 % of slopes count as the most: 1 / cos(0.02 pi) - 1 = 0.2 % of half, clipped.
    np.testing.assert_allclose(shares[inside], wanted[inside], atol=0.01)
    assert "doi" in said[-1]
    across = friction_shares(bright(wave, 0.1), "height", angle_deg + 180.0, ALL).shares
    np.testing.assert_allclose(across, 1.0 - shares, atol=1e-9)


def test_edges_are_bumps_whichever_way_they_go():
    step = np.zeros((40, 90))
    step[:, 30:60] = 1.0
    shares = friction_shares(bright(step, 0.1), "edges", 0.0, ALL).shares
    assert shares[:, 29:31].min() > 0.9
    assert shares[:, 59:61].min() > 0.9
    assert max(shares[:, :20].max(), shares[:, 40:50].max(), shares[:, 70:].max()) < 0.01


def test_an_even_picture_has_no_contrast():
    with pytest.raises(BadInputError, match="no contrast"):
        friction_shares(bright(np.full((5, 5), 0.4)), "luminance", 0.0, ALL)


def test_what_is_rendered_of_a_wave_is_what_output_and_finger_leave():
    """Closed forms: a held wave loses sinc(f T), a lag 1 / sqrt(1 + (f / 13.8 Hz per mm/s)^2)."""
    x_mm = 0.1 * (np.arange(600) + 0.5)
    wave = 0.7 + 0.05 * np.cos(math.tau * x_mm / 5.0)[None, :]  # whole periods between mirrors
    felt = rendered(wave, 1e-4, 0.05, (0.5, 1.0), Output(0.010, straight=False))
    hz = 10.0
    left = np.sinc(hz * 0.010) / math.hypot(1.0, hz / (13.8 * 50.0))
    np.testing.assert_allclose(felt, 0.7 + left * (wave - 0.7), atol=1e-9)
    # 100 Hz: not by a set point in 10 ms
    fine = 0.7 + 0.05 * np.cos(math.tau * x_mm / 0.5)[None, :]
    flat = rendered(fine, 1e-4, 0.05, (0.5, 1.0), Output(0.010, straight=False))
    np.testing.assert_allclose(flat, 0.7, atol=1e-9)


def test_one_command_makes_a_texture_that_loads_and_says_what_was_done(tmp_path, refuses):
    turned(tmp_path / "photo.jpg")
    words = ("texture", "from-image", tmp_path / "photo.jpg", "--width-mm", "30")
    said = said_by(*words, "--cof", "0.6", "0.75")
    texture = load_texture(said["texture"], [])
    assert texture.bounds() == pytest.approx((0.6, 0.75), abs=1e-4)
    ends = texture.cof_at(0.005, 0.010), texture.cof_at(0.025, 0.010)
    assert sorted(ends) == pytest.approx([0.6, 0.75], abs=1e-3)
    about = tomllib.loads((tmp_path / "photo.toml").read_text())["description"]
    assert "EXIF" in about
    assert "stretched" in about
    assert (tmp_path / "photo_preview.png").stat().st_size > 5000
    refuses("file_exists", *words)


def test_detail_that_the_rig_cannot_render_is_told(tmp_path):
    stripes = np.tile(np.repeat(np.array([[40, 200]], np.uint8), 3, axis=1), (60, 50))
    Image.fromarray(stripes).save(tmp_path / "fine.png")  # 0.6 mm: 83 Hz at 50 mm/s
    words = ("texture", "from-image", tmp_path / "fine.png", "--width-mm", "30", "--force", "--rig")
    assert "cannot render" in str(said_by(*words, "simulated")["warnings"])
    assert "cannot render" not in str(said_by(*words, "simulated-envelope")["warnings"])


@pytest.mark.parametrize(
    ("options", "code"),
    [
        ("--cof 0.8 0.6", "out_of_range"),
        ("--percentiles 90 10", "out_of_range"),
        ("--width-mm 0", "out_of_range"),
        ("--out x.json", "bad_ending"),
    ],
)
def test_options_that_make_no_sense(tmp_path, refuses, options, code):
    halves().save(tmp_path / "a.png")
    words = ("texture", "from-image", tmp_path / "a.png", "--width-mm", "30")
    refuses(code, *words, *options.split())


def test_what_is_no_picture_is_named(tmp_path, refuses):
    (tmp_path / "a.jpg").write_bytes(b"no picture")
    words = ("texture", "from-image", tmp_path / "a.jpg", "--width-mm", "30")
    assert "cannot be read as a picture" in refuses("bad_image", *words)["message"]
