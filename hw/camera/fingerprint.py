"""Pictures of a fingerprint under coaxial light, drawn with known areas.

Ridges that touch the screen are dark, valleys, pores and the bare screen are bright.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

Array = NDArray[np.float64]
FINER = 3  # a pixel is drawn as so many by so many


@dataclass(frozen=True)
class Optics:
    """What is the camera's and not the finger's.

    `blur_m` is the standard deviation of a point's image, and `vignette` is how much darker a
    corner is. `noise` is the standard deviation of a pixel as a share of white, and `light` is the
    bare screen's grey.
    """

    width: int = 640
    height: int = 512
    scale_m: float = 30e-6
    blur_m: float = 30e-6
    vignette: float = 0.25
    noise: float = 0.02
    light: float = 0.75
    ridge_darkness: float = 0.6


@dataclass(frozen=True)
class Touch:
    """An elliptic touch of this area, its centre off the picture's; `aspect` is long over short."""

    area_m2: float
    x_m: float = 0.0
    y_m: float = 0.0
    aspect: float = 1.25
    ridge_period_m: float = 0.48e-3
    ridge_share: float = 0.55
    pores_per_m2: float = 1.5e6
    pore_radius_m: float = 45e-6


class Drawn(NamedTuple):
    """A picture [y, x] of 8 bits with what is in it: the area within the outline, and the
    ridges'.
    """

    image: NDArray[np.uint8]
    area_m2: float
    ridge_area_m2: float


def bare(optics: Optics, random: np.random.Generator) -> NDArray[np.uint8]:
    """The screen without a finger."""
    dark = np.zeros((optics.height, optics.width))
    return _exposed(dark, optics, random)


def drawn(touch: Touch, optics: Optics, random: np.random.Generator) -> Drawn:
    """The finger on the screen."""
    x_m, y_m = _places(optics)
    short_m = np.sqrt(touch.area_m2 / (np.pi * touch.aspect))
    dx_m, dy_m = x_m - touch.x_m, y_m - touch.y_m
    within = (dx_m / short_m) ** 2 + (dy_m / (short_m * touch.aspect)) ** 2 <= 1.0
    ridges = within & _ridges(dx_m, dy_m, touch, random)
    ridges &= ~_pores(ridges, touch, optics, random)
    finest_m2 = (optics.scale_m / FINER) ** 2
    image = _exposed(_binned(ridges.astype(float)), optics, random)
    return Drawn(image, float(within.sum() * finest_m2), float(ridges.sum() * finest_m2))


def _places(optics: Optics) -> tuple[Array, Array]:
    """Where each fine pixel is, from the picture's centre."""
    step_m = optics.scale_m / FINER
    y, x = np.mgrid[: optics.height * FINER, : optics.width * FINER].astype(float)
    middle_x, middle_y = 0.5 * (optics.width * FINER - 1), 0.5 * (optics.height * FINER - 1)
    return (x - middle_x) * step_m, (y - middle_y) * step_m


def _ridges(x_m: Array, y_m: Array, touch: Touch, random: np.random.Generator) -> NDArray[np.bool_]:
    """Loops around a core below the middle, a little wavy."""
    core_m = -2.5e-3
    wave = random.uniform(0.0, 2.0 * np.pi, 2)
    away_m = np.hypot(x_m, 0.75 * (y_m - core_m))
    away_m = away_m + 0.12e-3 * np.sin(x_m / 1.3e-3 + wave[0]) * np.cos(y_m / 1.7e-3 + wave[1])
    phase = np.remainder(away_m / touch.ridge_period_m, 1.0)
    return np.asarray(phase < touch.ridge_share)


def _pores(
    ridges: NDArray[np.bool_], touch: Touch, optics: Optics, random: np.random.Generator
) -> NDArray[np.bool_]:
    """Round holes on the ridges."""
    step_m = optics.scale_m / FINER
    radius = touch.pore_radius_m / step_m
    places = np.flatnonzero(ridges)
    count = random.poisson(touch.pores_per_m2 * places.size * step_m**2)
    mask = np.zeros(ridges.shape, bool)
    if places.size == 0:
        return mask
    reach = int(np.ceil(radius))
    dy, dx = np.mgrid[-reach : reach + 1, -reach : reach + 1]
    dy, dx = dy[dy**2 + dx**2 <= radius**2], dx[dy**2 + dx**2 <= radius**2]
    y, x = np.unravel_index(random.choice(places, count), ridges.shape)
    rows = np.clip(y[:, None] + dy, 0, ridges.shape[0] - 1)
    columns = np.clip(x[:, None] + dx, 0, ridges.shape[1] - 1)
    mask[rows, columns] = True
    return mask


def _binned(fine: Array) -> Array:
    height, width = fine.shape[0] // FINER, fine.shape[1] // FINER
    return np.asarray(fine.reshape(height, FINER, width, FINER).mean(axis=(1, 3)))


def _exposed(dark: Array, optics: Optics, random: np.random.Generator) -> NDArray[np.uint8]:
    """The picture of a share of dark ridge in every pixel."""
    blurred = gaussian_filter(dark, optics.blur_m / optics.scale_m, mode="nearest")
    y, x = np.mgrid[-1.0 : 1.0 : optics.height * 1j, -1.0 : 1.0 : optics.width * 1j]
    light = optics.light * (1.0 - optics.vignette * (x**2 + y**2) / 2.0)
    grey = light * (1.0 - optics.ridge_darkness * blurred)
    grey = grey + optics.noise * random.standard_normal(grey.shape)
    return np.asarray(np.round(255.0 * np.clip(grey, 0.0, 1.0)), dtype=np.uint8)
