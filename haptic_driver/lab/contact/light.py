"""What of a picture is the light's and the screen's: taken out, so that the bare screen is 1."""

from __future__ import annotations

import numpy as np

from haptic_driver.signals import Array

ORDER = 4  # of the polynomial in each direction that follows the light
STEPS = 12
DARKER = 1.5  # standard deviations below which a pixel is no bare screen
NODES = 72  # along the longer side: light is smooth


def bare_light(frame: Array) -> Array:
    """The light of the bare screen [y, x], a polynomial through what a finger does not darken."""
    step = max(1, round(max(frame.shape) / NODES))
    height, width = (size // step * step for size in frame.shape)
    cells = frame[:height, :width].reshape(height // step, step, width // step, step)
    # what is bright of a cell is screen or valley, not ridge
    coarse = np.quantile(cells, 0.8, axis=(1, 3))
    terms = _terms(*coarse.shape)
    values = coarse.ravel()
    bright = np.ones(values.size, bool)
    weights: Array = np.zeros(terms.shape[1])
    for _ in range(STEPS):
        weights = np.asarray(np.linalg.lstsq(terms[bright], values[bright], rcond=None)[0])
        rest = values - terms @ weights
        spread = 1.4826 * np.median(np.abs(rest[bright] - np.median(rest[bright])))
        bright = rest > -DARKER * max(float(spread), 1e-6)
    return np.maximum(_terms(*frame.shape) @ weights, 1e-3).reshape(frame.shape)


def flattened(frame: Array, background: Array | None) -> Array:
    """The picture [y, x] over that of the screen without a finger; 1 where nothing touches.

    Without a `background`, and where the lamp differs from the background's, the light is estimated
    from the frame itself.
    """
    ratio = frame if background is None else frame / np.maximum(background, 1e-3)
    return np.asarray(ratio / bare_light(ratio))


def _terms(height: int, width: int) -> Array:
    """Products of Legendre polynomials up to `ORDER` together [height width, terms]."""
    y, x = np.linspace(-1.0, 1.0, height), np.linspace(-1.0, 1.0, width)
    of_y = np.polynomial.legendre.legvander(y, ORDER)
    of_x = np.polynomial.legendre.legvander(x, ORDER)
    both = [
        np.outer(of_y[:, i], of_x[:, j]).ravel()
        for i in range(ORDER + 1)
        for j in range(ORDER + 1 - i)
    ]
    return np.stack(both, axis=1)
