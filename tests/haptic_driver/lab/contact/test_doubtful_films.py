"""What a film says of its pixels and frames stands beside the areas."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from haptic_driver.lab.contact.film import read_film
from haptic_driver.lab.contact.judge import ODD, watch
from hw.camera.fingerprint import Optics, Touch, drawn

tifffile = pytest.importorskip("tifffile")
pytest.importorskip("skimage")
OPTICS = Optics(width=230, height=290, scale_m=50e-6, blur_m=15e-6)
SMALL = np.full((60, 64), 200, np.uint8)


def frame(seed: int, shift: int = 0) -> np.ndarray:
    image = drawn(Touch(5e-5), OPTICS, np.random.default_rng(seed)).image
    return np.roll(image, shift, axis=1) / 255.0


def said_of(*frames: np.ndarray) -> list[str]:
    return watch(lambda: list(frames), np.arange(float(len(frames))), OPTICS.scale_m).said


@settings(max_examples=20, deadline=None)
@given(wide=st.integers(1, 40), high=st.integers(1, 40))
def test_pixels_that_are_not_square_are_told(tmp_path_factory, wide, high):
    """Resolutions are pixels along a length: the more, the narrower each."""
    path = tmp_path_factory.mktemp("film") / "a.tif"
    tifffile.imwrite(path, SMALL, photometric="minisblack", resolution=(high, wide))
    told = [words for words in read_film(path).said if "as wide as high" in words]
    assert bool(told) == (wide != high)
    if told:
        assert float(told[0].split()[3]) == pytest.approx(wide / high, rel=5e-3)


def test_a_video_of_pixels_that_are_not_square_is_told(tmp_path):
    av = pytest.importorskip("av")
    with av.open(str(tmp_path / "a.mp4"), "w") as container:
        stream = container.add_stream("mpeg4", rate=25)
        stream.height, stream.width = SMALL.shape
        stream.codec_context.sample_aspect_ratio = Fraction(32, 27)
        picture = av.VideoFrame.from_ndarray(np.repeat(SMALL[..., None], 3, 2), format="rgb24")
        container.mux(stream.encode(picture))
        container.mux(stream.encode())
    assert any(
        "1.19 times as wide as high" in words for words in read_film(tmp_path / "a.mp4").said
    )


@settings(max_examples=20, deadline=None)
@given(
    numbers=st.sets(st.integers(0, 12), min_size=3, max_size=8), step=st.sampled_from([1, 2, 10])
)
def test_frames_that_are_missing_by_their_numbers_are_told(tmp_path_factory, numbers, step):
    folder = tmp_path_factory.mktemp("film")
    for number in numbers:
        tifffile.imwrite(folder / f"cam_1_{step * number}.tif", SMALL)
    steps = np.diff(sorted(numbers))
    if np.median(steps) != 1:
        return  # a film of another rate
    missing = int(np.sum(steps - 1))
    told = [words for words in read_film(folder).said if "by the numbers" in words]
    assert [int(words.split()[0]) for words in told] == ([missing] if missing else [])


def test_two_cameras_in_one_folder_are_told(tmp_path):
    for camera in (1, 2):
        for number in (1, 2, 3):
            tifffile.imwrite(tmp_path / f"cam_{camera}_{number}.tif", SMALL)
    (told,) = (words for words in read_film(tmp_path).said if "is it one film?" in words)
    assert told.startswith("3 numbers stand for several frames, as cam_1_1.tif and cam_2_1.tif")


def test_frames_that_repeat_are_told():
    frames = [frame(1), frame(1), frame(2), frame(2), frame(3)]
    assert "2 frames repeat the one before: they count again" in said_of(*frames)
    assert not any("repeat" in words for words in said_of(*frames[1:4:2]))


@settings(max_examples=5, deadline=None)
@given(seed=st.integers(0, 999), kind=st.sampled_from(("whole", "mosaic", "halves")))
def test_mosaics_and_halves_of_numbers_are_told(seed, kind):
    image = frame(seed)
    if kind == "mosaic":
        image[::2, ::2] *= 0.6
        image[1::2, 1::2] *= 0.5
    elif kind == "halves":
        image = (image * 4095).astype("<u2").view(np.uint8) / 255.0
    assert (ODD in said_of(image)) == (kind != "whole")


def test_interlaced_lines_are_told_where_the_finger_moves_by_half_a_ridge():
    """By less, or by a whole ridge, lines differ no more than by noise: some are missed."""
    told = 0
    for seed in range(6):
        image = frame(seed)
        image[1::2] = frame(seed + 1, 6)[1::2]
        told += ODD in said_of(image)
    assert told >= 5
