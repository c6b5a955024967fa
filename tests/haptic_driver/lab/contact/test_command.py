"""`haptic contact` on every kind of film that people have, and what it says of those that it cannot
use.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from haptic_driver.errors import BadInputError
from haptic_driver.lab.contact.scale import scale_from_ruler
from hw.camera.fingerprint import Optics, Touch, bare, drawn
from tests.haptic_driver.commands import rows_of, said_by

iio = pytest.importorskip("imageio.v3")
tifffile = pytest.importorskip("tifffile")
pytest.importorskip("rawpy")
pytest.importorskip("skimage")
OPTICS = Optics(width=288, height=352, scale_m=42e-6, blur_m=15e-6)
AREAS_M2 = (5e-5, 6e-5)
SCALE = ("--scale", "0.042")
TIMES_S = ("10.00", "10.02", "10.05")


@pytest.fixture(scope="module")
def images():
    """The screen alone, and a touch that grows."""
    random = np.random.default_rng(5)
    return [bare(OPTICS, random), *(drawn(Touch(a), OPTICS, random).image for a in AREAS_M2)]


def write_dng(path: Path, image: np.ndarray) -> None:
    """A raw picture of a sensor behind a mosaic of colours that all count alike."""
    identity = sum(((int(v), 1) for v in np.eye(3).ravel()), ())
    tags = [
        (33421, "H", 2, (2, 2), True),  # the mosaic: size, and red green green blue
        (33422, "B", 4, (0, 1, 1, 2), True),
        (50706, "B", 4, (1, 4, 0, 0), True),  # version
        (50708, "s", 0, "a camera", True),
        (50714, "H", 1, 0, True),  # black and white
        (50717, "I", 1, 255 * 257, True),
        (50721, "2i", 9, identity, True),  # from colours to the camera's
    ]
    counts = image.astype(np.uint16) * 257
    tifffile.imwrite(path, counts, photometric=32803, extratags=tags, metadata=None)


@pytest.fixture(scope="module")
def films(images, tmp_path_factory):
    """The same as a video, a stack, and a folder with time stamps."""
    folder = tmp_path_factory.mktemp("films")
    colours = np.repeat(np.stack(images)[..., None], 3, axis=3)
    iio.imwrite(folder / "film.avi", colours, plugin="pyav", fps=25, codec="ffv1")
    stack = np.stack(images).astype(np.uint16) * 257
    tifffile.imwrite(folder / "film.tif", stack, photometric="minisblack")
    (folder / "raw").mkdir()
    for number, image in enumerate(images):
        write_dng(folder / "raw" / f"img_{number}.dng", image)
    (folder / "frames").mkdir()
    for number, image in zip((8, 9, 10), images, strict=True):  # natural order, not that of letters
        iio.imwrite(folder / "frames" / f"img_{number}.png", image)
    stamps = "\n".join(f"img_{i + 8}, {time}" for i, time in enumerate(TIMES_S))
    (folder / "frames" / "times.csv").write_text(f"file, time in s\n{stamps}\n", encoding="utf-8")
    return folder


@pytest.mark.parametrize(
    ("name", "times_s"),
    [
        ("film.avi", (0.0, 0.04, 0.08)),
        ("film.tif", (0.0, 1.0, 2.0)),
        ("frames", (0.0, 0.02, 0.05)),
        ("raw", (0.0, 1.0, 2.0)),
    ],
)
def test_every_kind_of_film_gives_the_areas(films, tmp_path, name, times_s):
    out = tmp_path / "contact.csv"
    said = said_by("contact", films / name, *SCALE, "--out", out)
    assert (said["frames"], said["counted"], said["bad"]) == (3, 2, {"no finger": 1})
    rows = rows_of(out)
    assert [float(row["time_s"]) for row in rows] == pytest.approx(times_s)
    assert rows[0]["contact_area_m2"] == ""
    assert rows[0]["bad"] == "no finger"
    areas = [float(row["contact_area_m2"]) for row in rows[1:]]
    assert areas == pytest.approx(AREAS_M2, rel=0.03)  # what the method is good to
    for picture in said["pictures"]:
        assert Path(picture).read_bytes().startswith(b"\x89PNG")


def test_a_scale_has_to_be_said_and_said_once(films, refuses):
    command = ("contact", films / "film.tif")
    for words in ((), (*SCALE, "--scale-from", "ruler.png")):
        assert "--scale" in refuses("no_scale", *command, *words)["hint"]
    refuses("out_of_range", *command, "--scale", "21")


def test_what_is_no_film_is_refused(tmp_path, refuses):
    (tmp_path / "empty").mkdir()
    (tmp_path / "broken.avi").write_bytes(b"RIFF")
    (tmp_path / "broken.tif").write_bytes(b"II*")
    (tmp_path / "notes.doc").write_bytes(b"x")
    for name, code in (
        ("empty", "empty_film"),
        ("gone.avi", "no_film"),
        ("broken.avi", "bad_film"),
        ("broken.tif", "bad_image"),
        ("notes.doc", "bad_film"),
    ):
        refuses(code, "contact", tmp_path / name, *SCALE, "--out", tmp_path / "x.csv")


def test_a_background_has_to_be_a_picture_of_the_same_size(films, tmp_path, refuses):
    bad, other = tmp_path / "bad.png", tmp_path / "other.png"
    bad.write_bytes(b"no picture")
    iio.imwrite(other, np.full((200, 200), 180, np.uint8))
    words = ("contact", films / "frames", *SCALE, "--out", tmp_path / "x.csv", "--background")
    refuses("bad_image", *words, bad)
    refuses("bad_background", *words, other)


def test_a_film_without_a_touch_is_said(images, tmp_path, refuses):
    film = tmp_path / "film.tif"
    tifffile.imwrite(film, np.stack(images[:1] * 3), photometric="minisblack")
    words = ("contact", film, *SCALE, "--out", tmp_path / "x.csv", "--rate", "50")
    refuses("no_contact", *words, "--contact", "dark", status=1)


def test_a_background_takes_the_place_of_frames_without_a_finger(films, tmp_path):
    (tmp_path / "touches").mkdir()
    for number in (9, 10):
        name = f"img_{number}.png"
        (tmp_path / "touches" / name).write_bytes((films / "frames" / name).read_bytes())
    words = ("contact", tmp_path / "touches", *SCALE, "--out", tmp_path / "x.csv")
    bare = films / "frames" / "img_8.png"
    said = said_by(*words, "--background", bare, "--rate", "50")
    assert said["counted"] == 2
    assert said["area_m2"] == pytest.approx(np.mean(AREAS_M2), rel=0.03)


def test_a_missing_package_is_named_with_the_extra(films, tmp_path, refuses, monkeypatch):
    monkeypatch.setitem(sys.modules, "av", None)
    words = ("contact", films / "film.avi", *SCALE, "--out", tmp_path / "x.csv")
    error = refuses("missing_package", *words, status=1)
    assert "haptic-driver[camera]" in error["hint"]


@pytest.mark.parametrize(("period_px", "tilt"), [(23.7, 0.0), (41.3, 0.12)])
def test_a_ruler_gives_the_scale(tmp_path, period_px, tilt):
    y, x = np.mgrid[:300, :400]
    along = x * np.cos(tilt) + y * np.sin(tilt)
    lines = np.remainder(along / period_px, 1.0) < 0.2
    noise = np.random.default_rng(1).normal(0.0, 10.0, x.shape)
    iio.imwrite(tmp_path / "ruler.png", np.clip(200.0 - 150.0 * lines + noise, 0, 255).astype("u1"))
    found, said = scale_from_ruler(tmp_path / "ruler.png", 0.5)
    assert "lines" in said
    assert found == pytest.approx(0.5 / period_px, rel=2e-3)  # a tenth of a line over the picture


def test_a_picture_without_lines_gives_none(tmp_path):
    noise = np.random.default_rng(1).integers(0, 255, (200, 300)).astype(np.uint8)
    iio.imwrite(tmp_path / "noise.png", noise)
    with pytest.raises(BadInputError, match="no lines"):
        scale_from_ruler(tmp_path / "noise.png", 0.5)
