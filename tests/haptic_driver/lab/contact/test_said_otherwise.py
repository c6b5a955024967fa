"""What a film's file says and what a person says: where they differ it is told."""

from __future__ import annotations

import numpy as np
import pytest

from haptic_driver.errors import BadInputError
from haptic_driver.lab.contact.film import read_film
from haptic_driver.lab.contact.scale import scale_from_ruler, scale_told
from haptic_driver.lab.images.files import opened

tifffile = pytest.importorskip("tifffile")
FRAMES = np.arange(3, dtype=np.uint8)[:, None, None] + np.full((60, 64), 200, np.uint8)
GREY = {"photometric": "minisblack"}
IMAGEJ = {"axes": "TYX", "unit": "um", "finterval": 0.5}
OME = {
    "axes": "TYX",
    "PhysicalSizeX": 20,
    "PhysicalSizeXUnit": "µm",
    "TimeIncrement": 500,
    "TimeIncrementUnit": "ms",
}


@pytest.mark.parametrize(
    ("how", "times"),
    [
        ({"resolution": (500, 500), "resolutionunit": "CENTIMETER"}, False),
        ({"imagej": True, "resolution": (0.05, 0.05), "metadata": IMAGEJ}, True),
        ({"ome": True, "metadata": OME}, True),
    ],
    ids=["resolution", "ImageJ", "OME"],
)
def test_a_scale_and_a_rate_that_the_file_denies_are_told(tmp_path, how, times):
    path = tmp_path / "a.tif"
    tifffile.imwrite(path, FRAMES, **GREY, **how)
    film = read_film(path, rate_hz=25.0)
    assert scale_told(0.04, film, None) == ["the file says 0.02 mm per pixel: 0.04 is taken"]
    assert scale_told(0.02, film, None) == []
    rate = "the file says 2 frames a second: --rate 25 is taken"
    assert (rate in film.said) == times
    assert rate not in read_film(path, rate_hz=2.0).said


def test_a_resolution_in_inches_is_none(tmp_path):
    tifffile.imwrite(tmp_path / "a.tif", FRAMES, **GREY, resolution=(72, 72), resolutionunit="INCH")
    assert read_film(tmp_path / "a.tif").pixel_m is None


def test_every_frame_of_ome_is_read(tmp_path):
    tifffile.imwrite(tmp_path / "a.ome.tif", FRAMES, ome=True, metadata={"axes": "TYX"})
    with opened(tmp_path / "a.ome.tif") as pictures:
        for number in range(3):
            np.testing.assert_array_equal(pictures.read(number).values, FRAMES[number])


def test_planes_at_every_time_are_refused_as_channels_are(tmp_path):
    both = np.stack([FRAMES, FRAMES], axis=1)
    tifffile.imwrite(tmp_path / "a.tif", both, imagej=True, metadata={"axes": "TZYX"})
    with pytest.raises(BadInputError, match="2 planes in each frame"):
        read_film(tmp_path / "a.tif")


@pytest.mark.parametrize(
    ("names", "told"),
    [
        (["f-2", "f-1", "f0", "f1"], True),
        (["-1", "0", "1"], True),
        (["f-1", "f-2", "f-10"], False),
        (["1-2", "1-3", "2-1"], False),
    ],
)
def test_frames_stand_by_their_number_with_its_sign(tmp_path, names, told):
    for name in names:
        tifffile.imwrite(tmp_path / f"{name}.tif", FRAMES[0])
    film = read_film(tmp_path)
    assert [path.stem for path, _ in film.places] == names
    assert any("counts as its sign" in words for words in film.said) == told


def board(high: int, wide: int) -> np.ndarray:
    y, x = np.mgrid[0:240, 0:300]
    return np.where((x // wide + y // high) % 2, 220, 40).astype(np.uint8)


def test_squares_that_are_none_are_refused(tmp_path):
    tifffile.imwrite(tmp_path / "a.tif", board(20, 25), **GREY)
    with pytest.raises(BadInputError, match=r"squares of a checkerboard, .* by .* pixels"):
        scale_from_ruler(tmp_path / "a.tif", 1.0)
    tifffile.imwrite(tmp_path / "b.tif", board(25, 25), **GREY)
    assert scale_from_ruler(tmp_path / "b.tif", 1.0)[0] == pytest.approx(0.04, rel=0.01)


def test_a_ruler_of_another_size_than_the_film_is_told(tmp_path):
    tifffile.imwrite(tmp_path / "film.tif", FRAMES, **GREY)
    for name, image, told in (("same", FRAMES[0], []), ("larger", board(25, 25), ["300 x 240"])):
        tifffile.imwrite(tmp_path / f"{name}.tif", image, **GREY)
        said = scale_told(0.04, read_film(tmp_path / "film.tif"), tmp_path / f"{name}.tif")
        assert [words.split("is ")[1][:9] for words in said] == told
