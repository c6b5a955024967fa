"""Textures as they are seen: friction averaged over the cells of a grid, as fine as a screen shows
it.
"""

from __future__ import annotations

from math import ceil
from typing import NamedTuple

import numpy as np

from haptic_driver.render.texture import FloatArray, Texture

FINE_M = 100e-6  # between samples, where a cell is larger; finer than what a fingertip tells apart
MOST_PER_SIDE = 8  # samples of a cell along x and along y
STRIP_SAMPLES = 1 << 18  # at a time: what a strip of a picture takes in memory


class Grid(NamedTuple):
    """Square cells of `pitch_m` from the corner with the smallest x and y on: `columns` along +x,
    `rows` along +y.
    """

    x_m: float
    y_m: float
    pitch_m: float
    columns: int
    rows: int


def cell_means(texture: Texture, grid: Grid) -> FloatArray:
    """Mean friction [row, column] of each cell; NaN where a texture asks for nothing anywhere in
    it.

    Samples are jittered inside their part of a cell, along x and along y alike. Detail finer than
    their spacing turns into grain, not into a false moire.
    """
    per_side = min(ceil(grid.pitch_m / FINE_M), MOST_PER_SIDE)
    x_m = grid.x_m + grid.pitch_m * _spread(grid.columns, per_side, seed=1)
    y_m = grid.y_m + grid.pitch_m * _spread(grid.rows, per_side, seed=2)
    strip = max(STRIP_SAMPLES // (x_m.size * per_side), 1)  # rows of cells
    means = np.empty((grid.rows, grid.columns))
    for first in range(0, grid.rows, strip):
        rows = min(strip, grid.rows - first)
        cof = texture.cof_at(x_m[None, :], y_m[first * per_side : (first + rows) * per_side, None])
        cells = cof.reshape(rows, per_side, grid.columns, per_side)
        asked = np.isfinite(cells)
        counts = asked.sum(axis=(1, 3))
        sums = np.where(asked, cells, 0.0).sum(axis=(1, 3))
        means[first : first + rows] = np.where(counts > 0, sums / np.maximum(counts, 1), np.nan)
    return means


def levels(cof: FloatArray, low: float, high: float) -> bytes:
    """A byte for each friction, row by row: 0 for none, 1 at `low` to 255 at `high`."""
    share = (cof - low) / (high - low) if high > low else np.where(np.isfinite(cof), 0.5, np.nan)
    steps = 1.0 + np.round(254.0 * np.clip(share, 0.0, 1.0))
    return np.where(np.isfinite(cof), steps, 0.0).astype(np.uint8).tobytes()


def _spread(cells: int, per_side: int, seed: int) -> FloatArray:
    """Places of samples [cells * per_side] in units of a cell, in order."""
    places = np.arange(cells * per_side, dtype=np.float64)
    jitter = np.random.default_rng(seed).random(places.size) if per_side > 1 else 0.5
    return (places + jitter) / per_side
