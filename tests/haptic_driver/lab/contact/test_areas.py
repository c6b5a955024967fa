"""Areas against those of drawn films whose forms are not the shipped camera's, and on which nothing
was tuned.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest

from haptic_driver.lab.contact.judge import BLURRED, summary, watch

from . import drawing

pytest.importorskip("skimage")
AREA_WITHIN, RIDGES_WITHIN = 0.03, 0.05


class Error(NamedTuple):
    """Relative, of the mean over a film's frames; `ridges` is NaN where they are not told."""

    area: float
    ridges: float


def of_film(number: int) -> Error:
    """A film of one scene: the screen alone in every other one, then the touch twice, moved."""
    random = np.random.default_rng([4804, number])
    scene = drawing.scene(random)
    places = random.uniform(-4e-4, 4e-4, (2, 2))
    truths = [drawing.drawn(scene, random, (float(x), float(y))) for x, y in places]
    images = [truth.image / 255.0 for truth in truths]
    if number % 2:
        images = [drawing.bare(scene, random) / 255.0, *images]
    found = watch(lambda: images, np.arange(float(len(images))), scene.scale_m).found
    assert [one.bad for one in found if one.seen][-2:] in ([BLURRED] * 2, [""] * 2, [BLURRED, ""])
    told = summary(found)
    assert told.counted == 2
    area = np.mean([truth.area_m2 for truth in truths])
    ridges = np.mean([truth.ridge_area_m2 for truth in truths])
    return Error(told.area_m2 / area - 1.0, told.ridge_area_m2 / ridges - 1.0)


def check(count: int) -> None:
    errors = np.array([of_film(number) for number in range(count)])
    area, ridges = np.abs(errors[:, 0]), np.abs(errors[np.isfinite(errors[:, 1]), 1])
    print(
        f"{count} films: area off by {area.max():.2%} at most, {np.median(area):.2%} in the middle;"
        f" ridges, told in {ridges.size}, by {ridges.max():.2%} and {np.median(ridges):.2%}"
    )
    assert (area < AREA_WITHIN).all()
    assert (ridges < RIDGES_WITHIN).all()
    assert ridges.size > 0.8 * count  # blur goes up to where they are not told


def test_a_few_drawn_films():
    check(6)


@pytest.mark.soak
@pytest.mark.timeout(3600)
def test_two_hundred_drawn_films():
    check(200)
