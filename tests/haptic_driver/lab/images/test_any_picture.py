"""Pictures of every depth, polarity, sample format, order of planes and stack, written with the
libraries that other programs write with, against the shares that they were made of.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from PIL import Image

from haptic_driver.errors import BadInputError
from haptic_driver.lab.images.files import opened
from haptic_driver.lab.images.pixels import NO_DATA, full_scale, of_array, shares, told

tifffile = pytest.importorskip("tifffile")
# a byte's rounding, and that of a weighted sum of three
CLOSE = 1.01 / 255.0
quick = settings(
    max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)


@st.composite
def stacks(draw: st.DrawFn, most: int = 3) -> np.ndarray:
    """Shares [n, y, x] from black to white."""
    count = draw(st.integers(1, most))
    height, width = draw(st.tuples(st.integers(5, 9), st.integers(5, 12)))
    random = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    made = random.uniform(0.1, 0.9, (count, height, width))
    made[:, 0, :2] = 0.0, 1.0
    return made


def read_all(path: Path) -> np.ndarray:
    with opened(path) as pictures:
        pixels = [pictures.read(number) for number in range(pictures.count)]
    full = full_scale(pixels)
    return np.stack([shares(each, full) for each in pixels])


@quick
@given(
    made=stacks(),
    bits=st.sampled_from((8, 10, 12, 14, 16)),
    white_is_zero=st.booleans(),
    big=st.booleans(),
)
def test_counts_of_any_depth_and_polarity(tmp_path, made, bits, white_is_zero, big):
    white = 2**bits - 1
    counts = np.rint(white * (1.0 - made if white_is_zero else made))
    kind = np.dtype("u1" if bits == 8 else "u2")
    meaning = "miniswhite" if white_is_zero else "minisblack"
    tifffile.imwrite(
        tmp_path / "a.tif", counts.astype(kind), photometric=meaning, byteorder=">" if big else "<"
    )
    np.testing.assert_allclose(read_all(tmp_path / "a.tif"), made, atol=CLOSE)


@quick
@given(
    made=stacks(),
    kind=st.sampled_from(("f2", "f4", "f8", "i2", "i4", "u4")),
    low=st.floats(-900.0, 900.0),
    span=st.floats(100.0, 20000.0),
)
def test_formats_that_do_not_say_what_white_is_keep_their_proportions(
    tmp_path, made, kind, low, span
):
    values = (max(low, 0.0) if kind == "u4" else low) + span * made
    stored = values.astype(kind)
    tifffile.imwrite(tmp_path / "a.tif", stored, photometric="minisblack")
    read = read_all(tmp_path / "a.tif")
    want = stored.astype(float)
    # a quotient of the same numbers
    np.testing.assert_allclose(read * np.abs(want).max(), want, rtol=1e-9, atol=1e-9 * span)


@quick
@given(
    made=stacks(most=1),
    planar=st.booleans(),
    deep=st.booleans(),
    weights=st.tuples(*[st.floats(0.2, 1.0)] * 3),
)
def test_colours_in_pixels_or_in_planes_are_luminance(tmp_path, made, planar, deep, weights):
    """ITU-R BT.709: 0.2126 of red, 0.7152 of green, 0.0722 of blue."""
    white = 65535 if deep else 255
    colours = np.stack([weight * made[0] for weight in weights], axis=0 if planar else -1)
    stored = np.rint(white * colours).astype("u2" if deep else "u1")
    how = "separate" if planar else "contig"
    tifffile.imwrite(tmp_path / "a.tif", stored, photometric="rgb", planarconfig=how)
    luminance = float(np.dot(weights, (0.2126, 0.7152, 0.0722))) * made
    with opened(tmp_path / "a.tif") as pictures:
        assert pictures.in_planes == planar
        read = shares(pictures.read(0), float(white))
    np.testing.assert_allclose(read, luminance[0], atol=CLOSE)


@quick
@given(made=stacks(most=1), turn=st.integers(1, 8), tiff=st.booleans())
def test_every_orientation_is_turned_upright(tmp_path, made, turn, tiff):
    """TIFF 6.0: where the 0th row and column of what is stored lie."""
    upright = np.rint(255 * made[0]).astype("u1")
    stored = upright.T if turn >= 5 else upright
    # the first row is the bottom (3, 4) or the right (6, 7), the first column the other far side
    if turn in (3, 4, 6, 7):
        stored = stored[::-1]
    if turn in (2, 3, 7, 8):
        stored = stored[:, ::-1]
    if tiff:
        path = tmp_path / "a.tif"
        tag = (274, 3, 1, turn, True)
        tifffile.imwrite(path, np.ascontiguousarray(stored), extratags=[tag])
    else:
        path = tmp_path / "a.png"
        picture = Image.fromarray(np.ascontiguousarray(stored))
        about = picture.getexif()
        about[274] = turn
        picture.save(path, exif=about)
    np.testing.assert_allclose(read_all(path)[0], upright / 255.0, atol=1e-9)


@quick
@given(made=stacks(most=1), blank=st.sampled_from((*NO_DATA, -3.4e38, 1.7e38, np.nan, -np.inf)))
def test_what_has_no_number_takes_the_nearest(tmp_path, made, blank):
    heights = (30.0 + 10.0 * made[0]).astype("f4")
    holed = heights.copy()
    holed[2, 2] = holed[3, 3] = blank
    tifffile.imwrite(tmp_path / "a.tif", holed, photometric="minisblack")
    read = read_all(tmp_path / "a.tif")[0] * 40.0
    kept = np.ones(read.shape, bool)
    kept[2, 2] = kept[3, 3] = False
    np.testing.assert_allclose(read[kept], heights[kept], rtol=1e-6)
    assert read[2, 2] in read[1:4, 1:4][kept[1:4, 1:4]]


def test_gdals_own_tag_says_what_is_no_number(tmp_path):
    heights = np.full((20, 30), 5.0, "f4")
    heights[:, 15:] = 9.0
    heights[4, 4] = 7.0
    tifffile.imwrite(tmp_path / "a.tif", heights, extratags=[(42113, 2, 0, "7", True)])
    assert set(np.unique(np.rint(9.0 * read_all(tmp_path / "a.tif")))) == {5.0, 9.0}


def test_a_picture_mostly_without_numbers_is_refused(tmp_path):
    holes = np.full((20, 30), np.nan, "f4")
    holes[:5] = 1.0
    tifffile.imwrite(tmp_path / "a.tif", holes, photometric="minisblack")
    with pytest.raises(BadInputError, match="75% of a picture's pixels") as refused:
        read_all(tmp_path / "a.tif")
    assert refused.value.code == "no_numbers"


@quick
@given(made=stacks(), imagej=st.booleans(), compression=st.sampled_from((None, "zlib", "lzw")))
def test_a_stack_has_all_its_frames(tmp_path, made, imagej, compression):
    pytest.importorskip("imagecodecs")
    counts = np.rint(65535 * made).astype("u2")
    about = {"axes": "TYX", "finterval": 0.02} if imagej else None
    how = None if imagej else compression
    tifffile.imwrite(
        tmp_path / "a.tif",
        counts,
        imagej=imagej,
        photometric="minisblack",
        metadata=about,
        compression=how,
    )
    np.testing.assert_allclose(read_all(tmp_path / "a.tif"), made, atol=CLOSE)
    with opened(tmp_path / "a.tif") as pictures:
        times_s = pictures.times_s
    if imagej:
        np.testing.assert_allclose(times_s, 0.02 * np.arange(len(made)))
    else:
        assert times_s is None


@pytest.mark.parametrize(
    ("name", "mode"),
    [
        *(("a.png", mode) for mode in ("1", "P", "LA")),
        *(("a.tif", "CMYK"), ("a.jpg", "CMYK"), ("a.webp", "RGB"), ("a.bmp", "L")),
    ],
)
def test_pillows_modes(tmp_path, name, mode):
    grey = np.full((40, 60), 50, np.uint8)
    grey[:, 30:] = 200
    picture = Image.fromarray(grey)
    if mode == "1":
        grey = np.where(grey > 127, 255, 0)
        picture = picture.point(lambda value: 255 * (value > 127))
    how = {"lossless": True} if name.endswith("webp") else {}
    picture.convert(mode).save(tmp_path / name, **how)
    # a JPEG keeps such even parts to about two of 255
    read = read_all(tmp_path / name)[0]
    np.testing.assert_allclose(read[:, [3, -3]], grey[:, [3, -3]] / 255.0, atol=3 / 255)


def test_frames_of_an_animation_are_pictures_and_a_phones_two_are_one(tmp_path):
    frames = [Image.fromarray(np.full((40, 60), 60 * i, np.uint8)) for i in range(1, 4)]
    frames[0].save(
        tmp_path / "a.gif", save_all=True, append_images=frames[1:], duration=[40, 90, 20]
    )
    frames[0].save(tmp_path / "a.jpg", format="MPO", save_all=True, append_images=frames[1:2])
    assert read_all(tmp_path / "a.gif").mean(axis=(1, 2)) * 255 == pytest.approx([60, 120, 180])
    with opened(tmp_path / "a.gif") as pictures:
        assert pictures.times_s == pytest.approx([0.0, 0.04, 0.13])
    assert read_all(tmp_path / "a.jpg").shape == (1, 40, 60)


@pytest.mark.parametrize("end", [0, 65535])
def test_an_end_of_16_bits_that_stands_apart_is_told(end):
    heights = np.linspace(30000, 40000, 300).reshape(15, 20).astype("u2")
    assert not told(of_array(heights), 65535.0)
    heights[:3] = end
    assert f"20 % of the pixels are {end}" in told(of_array(heights), 65535.0)[0]


def test_channels_of_one_instant_are_not_frames(tmp_path):
    both = np.zeros((3, 2, 20, 30), "u2")
    tifffile.imwrite(tmp_path / "a.tif", both, imagej=True, metadata={"axes": "TCYX"})
    with pytest.raises(BadInputError, match=r"a\.tif: 2 channels") as refused:
        opened(tmp_path / "a.tif").__enter__()
    assert refused.value.code == "several_channels"


def test_complex_numbers_and_unknown_meanings_are_refused(tmp_path):
    tifffile.imwrite(tmp_path / "a.tif", np.ones((9, 9), "c8"))
    with pytest.raises(BadInputError, match="complex"):
        read_all(tmp_path / "a.tif")
    tifffile.imwrite(tmp_path / "b.tif", np.ones((9, 9), "u1"), photometric="cfa")
    with pytest.raises(BadInputError, match="32803 is not understood"):
        read_all(tmp_path / "b.tif")
