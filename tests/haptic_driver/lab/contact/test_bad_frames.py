"""Frames that are no use are marked with why, and no mean has them in it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import uniform_filter1d

from haptic_driver.lab.contact.judge import GLARE, MOTION, NO_FINGER, OUTSIDE, summary, watch
from hw.camera.fingerprint import Optics, Touch, bare, drawn

pytest.importorskip("skimage")
OPTICS = Optics(width=330, height=400, scale_m=42e-6, blur_m=15e-6)
TOUCH = Touch(8e-5)


def pictures() -> dict[str, np.ndarray]:
    """One good frame twice, and each kind of bad one."""
    random = np.random.default_rng(3)
    good = drawn(TOUCH, OPTICS, random).image
    glaring = good.copy()
    glaring[180:200, 150:170] = 255
    half = drawn(replace(TOUCH, x_m=6e-3), OPTICS, random).image
    smeared = uniform_filter1d(uniform_filter1d(good.astype(float), 7, axis=0), 7, axis=1)
    return {
        "good": good,
        NO_FINGER: bare(OPTICS, random),
        GLARE: glaring,
        OUTSIDE: half,
        MOTION: smeared.astype(np.uint8),
        "another": drawn(TOUCH, OPTICS, random).image,
    }


@pytest.fixture(scope="module")
def found():
    images = {name: image / 255.0 for name, image in pictures().items()}
    seen = watch(lambda: list(images.values()), np.arange(6.0), OPTICS.scale_m).found
    return dict(zip(images, seen, strict=True))


@pytest.mark.parametrize("why", [NO_FINGER, GLARE, OUTSIDE, MOTION])
def test_a_bad_frame_says_why_and_has_no_area(found, why):
    assert found[why].bad == why
    assert np.isnan(found[why].area_m2)


def test_only_good_frames_are_averaged(found):
    told = summary(list(found.values()))
    assert (told.frames, told.counted) == (6, 2)
    assert told.bad == dict.fromkeys((NO_FINGER, GLARE, OUTSIDE, MOTION), 1)
    both = [found["good"].area_m2, found["another"].area_m2]
    assert told.area_m2 == pytest.approx(np.mean(both))
    assert told.area_m2 == pytest.approx(8e-5, rel=0.03)  # what the method is good to


def test_axes_and_centre_are_those_of_the_drawn_ellipse(found):
    seen = found["good"].seen
    assert seen is not None
    short_m = 2.0 * np.sqrt(8e-5 / (np.pi * 1.25))
    assert seen.axes_m == pytest.approx((1.25 * short_m, short_m), rel=0.03)
    middle_m = (0.5 * 330 * 42e-6, 0.5 * 400 * 42e-6)
    assert seen.centre_m == pytest.approx(middle_m, abs=0.1e-3)
    assert seen.angle_rad == pytest.approx(np.pi / 2.0, abs=0.1)  # the longer axis along y
