"""How large a pixel is: as said, or by a picture of a ruler with lines of a known pitch."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from haptic_driver.errors import BadInputError, require_range
from haptic_driver.lab.contact.film import grey, read_picture
from haptic_driver.signals import Array

MM_PER_PIXEL = (1e-4, 1.0)
LEAST_LINES = 4
CLEAR = 6.0  # times the usual strength of any other frequency
HARMONIC = 0.5  # of the strongest line, from which on a slower one is the pitch itself


def scale_from_ruler(path: Path, pitch_mm: float) -> float:
    """Mm per pixel of a picture [y, x] whose lines lie `pitch_mm` apart in one direction.

    BadInputError where no direction has clear lines.
    """
    require_range("--pitch", pitch_mm, 0.01, 100.0, unit=" mm")
    if not path.is_file():
        raise BadInputError("no_ruler", f"{path}: is not there", "Give a picture of a ruler")
    picture = grey(read_picture(path))
    across, along = (_pitch_px(picture - picture.mean(), axis) for axis in (1, 0))
    period_px, strength = max((across, along), key=lambda found: found[1])
    if strength < CLEAR:
        said = f"{path}: has no lines at even distances that are clear enough"
        raise BadInputError("no_ruler", said, "Lay the ruler along the picture, in focus")
    return pitch_mm / period_px


def _pitch_px(picture: Array, axis: int) -> tuple[float, float]:
    """Distance of lines in pixels along an axis, any tilt allowed, and how clear they are.

    The strongest frequency of the picture; slower ones that are nearly as strong are the pitch, and
    it a harmonic of ticks.
    """
    height, width = picture.shape
    window = np.hanning(height)[:, None] * np.hanning(width)
    size = (2 * height, 2 * width)
    power = np.abs(np.fft.rfft2(picture * window, size))
    f_y, f_x = np.fft.fftfreq(size[0])[:, None], np.fft.rfftfreq(size[1])
    frequency = np.hypot(f_y, f_x)
    mine = (np.abs(f_x) >= np.abs(f_y)) if axis == 1 else (np.abs(f_y) > np.abs(f_x))
    allowed = mine & (frequency * picture.shape[axis] >= LEAST_LINES) & (frequency < 0.45)
    strong = np.where(allowed, power, 0.0)
    top = strong.max()
    candidates = np.where(strong >= HARMONIC * top, frequency, np.inf)
    y, x = np.unravel_index(int(np.argmin(candidates)), candidates.shape)
    for _ in range(2):  # from the flank of a line to its middle, then the middle of what is there
        near = allowed & (np.hypot(f_y - f_y[y], f_x - f_x[x]) < 2.5 / min(size))
        y, x = np.unravel_index(int(np.argmax(np.where(near, power, 0.0))), power.shape)
    weight = np.where(near, power**2, 0.0) / np.sum(power[near] ** 2)
    exact = float(np.hypot(np.sum(weight * f_y), np.sum(weight * f_x)))
    usual = float(np.median(power[allowed]))
    return 1.0 / exact, float(top) / max(usual, 1e-12) / 10.0
