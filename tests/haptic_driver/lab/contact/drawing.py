"""Films of fingerpads for judging the method: outlines, ridges, light and blur of other forms than
the shipped camera's.

The outline is no ellipse but a wavy superellipse. Ridges are where band-passed noise is high, as
the patterns that reaction and diffusion make. The lamp is a spot beside the middle, blur a disc and
not a Gaussian, noise that of counted photons.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.fft import irfft2, rfft2
from scipy.ndimage import binary_dilation, zoom
from scipy.signal import fftconvolve

FINER = 3


@dataclass(frozen=True)
class Scene:
    """What a film shows; lengths in m. `photons` of a white pixel; `disc_m` the radius of blur."""

    scale_m: float
    disc_m: float
    photons: float
    light: float
    spot: float  # how much darker the farthest corner is
    depth: float  # how much darker a ridge is than the bare screen
    valley: float  # how much darker a valley is
    period_m: float
    share: float
    long_m: float
    short_m: float
    power: float
    wave: float
    tilt_rad: float


@dataclass(frozen=True)
class Truth:
    image: np.ndarray
    area_m2: float
    ridge_area_m2: float


def scene(random: np.random.Generator) -> Scene:
    scale_m = float(random.uniform(20e-6, 38e-6))
    fits_m = 0.40 * HEIGHT * scale_m
    long_m = float(random.uniform(0.8, 1.0)) * fits_m
    return Scene(
        scale_m=scale_m,
        disc_m=float(random.uniform(10e-6, 80e-6)),  # as wide as a Gaussian of half of it
        photons=float(np.exp(random.uniform(np.log(400.0), np.log(2e4)))),  # 5 % to 0.7 % of white
        light=float(random.uniform(0.35, 0.9)),
        spot=float(random.uniform(0.0, 0.5)),
        depth=float(random.uniform(0.2, 0.7)),
        valley=float(random.uniform(0.0, 0.08)),
        period_m=float(random.uniform(0.42e-3, 0.58e-3)),
        share=float(random.uniform(0.4, 0.65)),
        long_m=long_m,
        short_m=long_m * float(random.uniform(0.7, 0.95)),
        power=float(random.uniform(1.8, 2.6)),
        wave=float(random.uniform(0.0, 0.04)),
        tilt_rad=float(random.uniform(-0.6, 0.6)),
    )


HEIGHT, WIDTH = 340, 380


def drawn(
    one: Scene, random: np.random.Generator, off_m: tuple[float, float] = (0.0, 0.0)
) -> Truth:
    """A frame, the centre of the touch `off_m` (x, y) from the picture's."""
    step_m = one.scale_m / FINER
    y, x = np.mgrid[: HEIGHT * FINER, : WIDTH * FINER] + 0.5
    x, y = (
        (x - 0.5 * WIDTH * FINER) * step_m - off_m[0],
        (y - 0.5 * HEIGHT * FINER) * step_m - off_m[1],
    )
    within = _outline(one, x, y, random)
    ridges = within & _ridges(one, x.shape, step_m, random)
    ridges &= ~_pores(ridges, step_m, random)
    dark = one.valley * within + (one.depth - one.valley) * ridges
    dark = _binned(dark)
    image = _photographed(one, dark, random)
    return Truth(image, float(within.sum() * step_m**2), float(ridges.sum() * step_m**2))


def bare(one: Scene, random: np.random.Generator) -> np.ndarray:
    return _photographed(one, np.zeros((HEIGHT, WIDTH)), random)


def _outline(one: Scene, x, y, random) -> np.ndarray:
    c, s = np.cos(one.tilt_rad), np.sin(one.tilt_rad)
    u, v = (c * x + s * y) / one.short_m, (-s * x + c * y) / one.long_m
    angle, phase = np.arctan2(v, u), random.uniform(0.0, 2 * np.pi, 2)
    wavy = 1 + one.wave * (np.sin(3 * angle + phase[0]) + 0.5 * np.sin(5 * angle + phase[1]))
    return np.abs(u) ** one.power + np.abs(v) ** one.power <= wavy**one.power


def _ridges(one: Scene, shape, step_m: float, random) -> np.ndarray:
    coarse = 4  # the pattern is smooth: it is made on a coarser grid
    small = tuple(-(-size // coarse) for size in shape)
    f_y = np.fft.fftfreq(small[0], coarse * step_m)[:, None]
    f_x = np.fft.rfftfreq(small[1], coarse * step_m)
    frequency = np.hypot(f_y, f_x) * one.period_m
    band = np.exp(-(((frequency - 1.0) / 0.12) ** 2))
    pattern = irfft2(rfft2(random.standard_normal(small)) * band, s=small)
    fine = zoom(pattern, coarse, order=3)[: shape[0], : shape[1]]
    return fine > np.quantile(pattern, 1.0 - one.share)


def _pores(ridges: np.ndarray, step_m: float, random) -> np.ndarray:
    """Squares on the ridges, two to the square millimetre."""
    places = np.flatnonzero(ridges)
    points = np.zeros(ridges.shape, bool)
    points.flat[random.choice(places, round(2e6 * places.size * step_m**2))] = True
    return binary_dilation(points, np.ones((3, 3)), iterations=max(1, round(35e-6 / step_m)))


def _binned(fine: np.ndarray) -> np.ndarray:
    return fine.reshape(HEIGHT, FINER, WIDTH, FINER).mean(axis=(1, 3))


def _photographed(one: Scene, dark: np.ndarray, random) -> np.ndarray:
    fine = 3
    reach = int(np.ceil(one.disc_m / one.scale_m)) + 1
    n = (2 * reach + 1) * fine
    places = (np.arange(n) - 0.5 * (n - 1)) / fine * one.scale_m
    disc = np.hypot(places[:, None], places) <= one.disc_m
    kernel = disc.reshape(2 * reach + 1, fine, 2 * reach + 1, fine).mean(axis=(1, 3))
    padded = np.pad(dark, reach, mode="edge")
    blurred = fftconvolve(padded, kernel / kernel.sum(), mode="valid")
    y, x = np.mgrid[0.0 : 1.0 : HEIGHT * 1j, 0.0 : 1.0 : WIDTH * 1j]
    away = ((x - 0.35) ** 2 + (y - 0.6) ** 2) / 0.785
    light = one.light * (1.0 - one.spot * away / (0.3 + 0.7 * away))
    grey = light * (1.0 - blurred)
    counted = random.poisson(np.clip(grey, 0.0, 1.0) * one.photons) / one.photons
    return np.round(255 * np.clip(counted, 0.0, 1.0)).astype(np.uint8)
