"""Pictures of textures: where things are, and that nothing is made up where they are finer than a
cell.
"""

import math

import numpy as np
import pytest

from haptic_driver.render.texture import FrictionMap, Grating, Profile, Uniform
from haptic_driver.textures.tile import STRIP_SAMPLES, Grid, cell_means, levels


def test_rows_go_along_y_and_columns_along_x():
    corner = np.full((4, 6), 0.5)
    corner[0, 5] = 0.7  # small y, large x
    means = cell_means(FrictionMap(corner, 1e-3, 1e-3), Grid(0.0, 0.0, 1e-3, 6, 4))
    assert means.shape == (4, 6)
    assert np.unravel_index(means.argmax(), means.shape) == (0, 5)


def test_a_part_of_a_texture_is_that_part():
    ramp = Profile([0.0, 0.1], [0.5, 0.7])
    means = cell_means(ramp, Grid(0.04, 0.0, 1e-5, 3, 1))
    assert means[0] == pytest.approx([0.5 + 2.0 * (0.04 + x) for x in (0.5e-5, 1.5e-5, 2.5e-5)])


@pytest.mark.parametrize("period_m", [0.3e-3, 0.5e-3])
def test_what_is_finer_than_a_cell_is_averaged_without_a_moire(period_m):
    means = cell_means(Grating(0.6, 0.1, period_m), Grid(0.0, 0.0, 1e-3, 100, 20))
    assert means == pytest.approx(0.6, abs=0.05)  # of 0.1
    assert means.mean() == pytest.approx(0.6, abs=0.005)


def test_what_is_coarser_than_a_cell_keeps_its_depth():
    means = cell_means(Grating(0.6, 0.1, 1e-3), Grid(0.0, 0.0, 1e-4, 100, 2))
    assert (means.min(), means.max()) == pytest.approx((0.5, 0.7), abs=0.005)


def test_nothing_is_nothing_and_an_edge_counts_what_is_there():
    means = cell_means(Profile([0.0, 0.0105], [0.5, 0.5]), Grid(0.0, 0.0, 1e-3, 12, 1))
    assert means[0, :11] == pytest.approx(0.5)
    assert math.isnan(means[0, 11])


def test_strips_make_one_picture():
    texture, tall = Grating(0.6, 0.1, 2e-3, direction_rad=1.0), Grid(0.0, 0.0, 4e-4, 256, 256)
    assert tall.columns * tall.rows * 16 > 2 * STRIP_SAMPLES
    y_m = (np.arange(256)[:, None] + 0.5) * 4e-4
    x_m = (np.arange(256)[None, :] + 0.5) * 4e-4
    assert cell_means(texture, tall) == pytest.approx(texture.cof_at(x_m, y_m), abs=0.05)


def test_levels_keep_nothing_apart_from_the_lowest():
    assert list(levels(np.array([[math.nan, 0.5, 0.6, 0.7]]), 0.5, 0.7)) == [0, 1, 128, 255]
    assert list(levels(cell_means(Uniform(0.6), Grid(0.0, 0.0, 1e-3, 1, 1)), 0.6, 0.6)) == [128]
