"""The touch in one flattened picture: outline, axes, centre, and the ridges inside.

The mean darkness over a ridge and a valley steps at the outline. Half of the step is where the
outline is, whatever the blur. Ridges are darker than half-way between the ridges' level and the
valleys', which blur leaves where an edge was.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import nan
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_erosion, binary_fill_holes, gaussian_filter

from haptic_driver.errors import optional
from haptic_driver.lab.images.files import EXTRA
from haptic_driver.signals import Array, Mask

RIDGE_PERIOD_M = 0.5e-3  # of fingertips, 0.4 to 0.6 mm
SMOOTHING = 0.5  # of a period: leaves 1 % of the ridges in what tells the outline
# Of a ridge, which is half of a period: fewer give neither its edges nor their blur.
LEAST_RIDGE_PIXELS = 4
FINEST_M = 20e-6  # over which noise is averaged where ridges are found
LEAST_DARKENING = 0.03  # of the bare screen's light
NOISE_FACTOR = 8.0  # by how much the touch has to stand out of the smoothed noise
# Of the pixels of ridges, and of valleys: where blur has left their levels, in narrow ones too.
PLATEAU = 0.75
NEAR_EDGE = 0.1  # of the contrast: pixels that tell the slope of ridges' edges
LEAST_AREA_M2 = 3e-6


@dataclass(frozen=True)
class Seen:
    """A touch as a frame shows it; lengths in m from the picture's upper left corner.

    `axes_m` the longer and the shorter axis of the ellipse of the same moments, `angle_rad` of the
    longer from x to y, 0 to pi. `contrast`: how much darker ridges are than valleys, of the bare
    screen's light. `blur_m`: standard deviation of a point's image, measured at the ridges' edges.
    Both and the ridges' area are NaN where pixels are too coarse for ridges.

    `mask` [y, x] is the touch, `outline` its closed line [n, 2] as (y, x) in pixels. `clarity` is
    how far the levels inside and outside lie apart, in their standard deviations: large of a touch
    on an even screen. `others` touches are smaller.
    """

    area_m2: float
    ridge_area_m2: float
    centre_m: tuple[float, float]
    axes_m: tuple[float, float]
    angle_rad: float
    contrast: float
    blur_m: float
    mask: Mask
    outline: Array
    clarity: float
    others: int


def has_ridges(scale_m: float) -> bool:
    """Whether a ridge has enough pixels to be seen."""
    return LEAST_RIDGE_PIXELS * scale_m <= 0.5 * RIDGE_PERIOD_M


def find_touch(flat: Array, scale_m: float) -> Seen | None:
    """The largest dark touch in a picture [y, x] whose bare screen is 1; None of none."""
    filters = optional("skimage.filters", EXTRA, "contact area")
    sigma = _sigma_px(scale_m)
    dark = 1.0 - np.clip(flat, 0.0, 2.0)
    mean_dark = gaussian_filter(dark, sigma, mode="nearest")
    within = mean_dark > filters.threshold_otsu(mean_dark)
    core = binary_erosion(within, iterations=max(1, round(sigma)))
    if not core.any() or within.all():
        return None
    level, bare = float(np.median(mean_dark[core])), float(np.median(mean_dark[~within]))
    if level - bare < max(LEAST_DARKENING, NOISE_FACTOR * _smoothed_noise(dark, sigma)):
        return None
    half = 0.5 * (level + bare)
    mask, sizes = _largest(mean_dark > half)
    if mask.sum() * scale_m**2 < LEAST_AREA_M2:
        return None
    others = int(np.sum(sizes * scale_m**2 >= LEAST_AREA_M2)) - 1
    seen = _measured(dark, mean_dark, mask, half, scale_m)
    return replace(seen, clarity=_clarity(mean_dark, mask, sigma), others=max(others, 0))


def _clarity(mean_dark: Array, mask: Mask, sigma: float) -> float:
    away = max(1, round(2.0 * sigma))
    inside = mean_dark[binary_erosion(mask, iterations=away)]
    outside = mean_dark[binary_erosion(~mask, iterations=away, border_value=1)]
    if not inside.size or not outside.size:
        return 0.0
    spread = np.hypot(inside.std(), outside.std())
    return float((inside.mean() - outside.mean()) / max(spread, 1e-6))


def _sigma_px(scale_m: float) -> float:
    """Of the smoothing that tells the outline; a pixel at least, over which slopes are taken."""
    return max(SMOOTHING * RIDGE_PERIOD_M / scale_m, 1.0)


def _smoothed_noise(dark: Array, sigma: float) -> float:
    """Standard deviation of what is left of the pixels' noise after smoothing."""
    crossed = dark[1:, 1:] - dark[1:, :-1] - dark[:-1, 1:] + dark[:-1, :-1]  # no smooth slope in it
    noise = 0.5 * 1.4826 * float(np.median(np.abs(crossed)))
    return float(noise / (2.0 * np.sqrt(np.pi) * sigma))


def _largest(mask: Mask) -> tuple[Mask, NDArray[np.int_]]:
    """The largest connected part, its holes filled, and how many pixels every part has."""
    measure = optional("skimage.measure", EXTRA, "contact area")
    labels = measure.label(mask)
    sizes = np.bincount(labels.ravel())
    sizes[0] = 0
    return np.asarray(binary_fill_holes(labels == int(np.argmax(sizes)))), sizes


def _measured(dark: Array, mean_dark: Array, mask: Mask, half: float, scale_m: float) -> Seen:
    measure = optional("skimage.measure", EXTRA, "contact area")
    (region,) = measure.regionprops(mask.astype(np.uint8))
    area_px = _subpixel_area(mean_dark, mask, half)
    # a round step that is smoothed has its half-way a little inside: sigma^2/(2 R)
    area_px *= 1.0 + np.pi * _sigma_px(scale_m) ** 2 / area_px
    ridges, contrast, blur_m = _ridges(dark, mask, scale_m) if has_ridges(scale_m) else 3 * (nan,)
    (y, x), turn = region.centroid, float(region.orientation)
    return Seen(
        area_m2=float(area_px * scale_m**2),
        ridge_area_m2=float(ridges * area_px * scale_m**2),
        centre_m=(float(x) * scale_m, float(y) * scale_m),
        axes_m=(
            float(region.axis_major_length) * scale_m,
            float(region.axis_minor_length) * scale_m,
        ),
        angle_rad=float(np.remainder(np.pi / 2.0 - turn, np.pi)),
        contrast=contrast,
        blur_m=blur_m,
        mask=mask,
        outline=_outline(measure, mean_dark, mask, half),
        clarity=0.0,
        others=0,
    )


def _subpixel_area(mean_dark: Array, mask: Mask, half: float) -> float:
    """Pixels within the outline; those that it crosses count in part."""
    slope_y, slope_x = np.gradient(mean_dark)
    slope = np.maximum(np.hypot(slope_y, slope_x), 1e-9)
    share = np.clip(0.5 + (mean_dark - half) / slope, 0.0, 1.0)
    inner = binary_erosion(mask, iterations=2)
    near = binary_erosion(~mask, iterations=2, border_value=1)
    return float(inner.sum() + share[~inner & ~near].sum())


def _ridges(dark: Array, mask: Mask, scale_m: float) -> tuple[float, float, float]:
    """The ridges' share of the touch, how much darker they are than valleys, and the blur in m."""
    filters = optional("skimage.filters", EXTRA, "contact area")
    smoothed_px = max(FINEST_M / scale_m, 0.6)
    fine = gaussian_filter(dark, smoothed_px, mode="nearest")
    inside = fine[mask]
    limit = float(filters.threshold_otsu(inside))
    high = float(np.quantile(inside[inside > limit], PLATEAU))
    low = float(np.quantile(inside[inside <= limit], 1.0 - PLATEAU))
    contrast, limit = high - low, 0.5 * (high + low)
    slope = np.hypot(*np.gradient(fine))[mask]
    at_edges = slope[np.abs(inside - limit) < NEAR_EDGE * contrast]
    steepest = float(np.median(at_edges)) if at_edges.size else 0.0
    # of a step that is blurred by s the slope is its height/(s sqrt(2 pi)); variances add up
    total_px = contrast / (np.sqrt(2.0 * np.pi) * max(steepest, 1e-9))
    blur_m = float(np.sqrt(max(total_px**2 - smoothed_px**2, 0.0))) * scale_m
    return float(np.mean(inside > limit)), contrast, blur_m


def _outline(measure: Any, mean_dark: Array, mask: Mask, half: float) -> Array:
    alone = np.where(_grown(mask), mean_dark, half - 1.0)
    lines = measure.find_contours(np.pad(alone, 1, constant_values=half - 1.0), half)
    return np.asarray(max(lines, key=len)) - 1.0


def _grown(mask: Mask) -> Mask:
    return np.asarray(~binary_erosion(~mask, border_value=1))
