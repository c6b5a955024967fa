"""How large a pixel is: as said, or by a picture of a ruler, a grid or a checkerboard.

A grid of lines and a checkerboard both have a strongest wave in two directions. A checkerboard
turns into its negative where it is moved by a square, which lies between the two.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np

from haptic_driver.errors import BadInputError, require_range
from haptic_driver.lab.contact.film import ALIKE, Film, read_bare
from haptic_driver.signals import Array, Mask

MM_PER_PIXEL = (1e-4, 1.0)
LEAST_LINES = 4
CLEAR = 6.0  # times the usual strength of any other frequency
HARMONIC = 0.5  # of the strongest line, from which on a slower one is the pitch itself
NEGATIVE = -0.5  # correlation with itself; that of a grid of thin lines is -0.2


class Wave(NamedTuple):
    """A strong wave of a picture: cycles per pixel along y and x, and how clear it is."""

    y: float
    x: float
    clear: float

    @property
    def pitch_px(self) -> float:
        return 1.0 / float(np.hypot(self.y, self.x))


def scale_told(mm: float, film: Film, ruler: Path | None) -> list[str]:
    """What speaks against a scale in mm per pixel: the film's file, or a ruler of another size."""
    said = []
    if film.pixel_m and abs(1e3 * film.pixel_m / mm - 1.0) > ALIKE:
        said.append(f"the file says {1e3 * film.pixel_m:.4g} mm per pixel: {mm:.4g} is taken")
    shape = film.shape if ruler is None else read_bare(ruler).shape
    if shape != film.shape:
        sizes = f"{shape[1]} x {shape[0]} pixels, a frame {film.shape[1]} x {film.shape[0]}"
        said.append(f"the ruler's picture is {sizes}: the scale is wrong if either was resized")
    return said


def scale_from_ruler(path: Path, pitch_mm: float) -> tuple[float, str]:
    """Mm per pixel of a picture [y, x], and what was seen in it. Lines are `pitch_mm` apart, in one
    direction or in two; squares have that side.

    BadInputError where nothing is clear, and where two directions have different pitches.
    """
    require_range("--pitch", pitch_mm, 0.01, 100.0, unit=" mm")
    if not path.is_file():
        raise BadInputError("no_ruler", f"{path}: is not there", "Give a picture of a ruler")
    picture = read_bare(path)
    first, second = _waves(picture - picture.mean())
    if first is None:
        said = f"{path}: has no lines at even distances that are clear enough"
        raise BadInputError("no_ruler", said, "Lay the ruler along the picture, in focus")
    if second is None:
        return pitch_mm / first.pitch_px, f"lines {first.pitch_px:.4g} pixels apart"
    if abs(second.pitch_px / first.pitch_px - 1.0) > ALIKE:
        pitches = f"{first.pitch_px:.4g} and {second.pitch_px:.4g} pixels"
        said = f"{path}: has lines in two directions, {pitches} apart"
        raise BadInputError("two_rulers", said, "Cut out the lines that are --pitch apart")
    pitch_px = 0.5 * (first.pitch_px + second.pitch_px)
    if _is_checkerboard(picture - picture.mean(), first, second):
        sides = [1.0 / float(np.hypot(*along)) for along in _sides(first, second)]
        if abs(sides[1] / sides[0] - 1.0) > ALIKE:
            said = f"{path}: squares of a checkerboard, {sides[0]:.4g} by {sides[1]:.4g} pixels"
            raise BadInputError("two_rulers", said, "Look at it straight, with square pixels")
        side_px = pitch_px / np.sqrt(2.0)
        return pitch_mm / side_px, f"squares of a checkerboard, {side_px:.4g} pixels wide"
    return pitch_mm / pitch_px, f"lines in two directions, {pitch_px:.4g} pixels apart"


def _waves(picture: Array) -> tuple[Wave | None, Wave | None]:
    """The strongest wave, and one across it that is as strong; None where nothing is clear."""
    window = np.hanning(picture.shape[0])[:, None] * np.hanning(picture.shape[1])
    size = (2 * picture.shape[0], 2 * picture.shape[1])
    power = np.abs(np.fft.rfft2(picture * window, size))
    f_y: Array = np.asarray(np.fft.fftfreq(size[0])[:, None], np.float64)
    f_x: Array = np.asarray(np.fft.rfftfreq(size[1]), np.float64)
    frequency = np.hypot(f_y, f_x)
    within = np.hypot(f_y * picture.shape[0], f_x * picture.shape[1])
    allowed = (within >= LEAST_LINES) & (frequency < 0.45)
    usual = 10.0 * max(float(np.median(power[allowed])), 1e-12)
    first = _wave(power / usual, f_y, f_x, allowed)
    if first.clear < CLEAR:
        return None, None
    along = np.abs(f_y * first.y + f_x * first.x) * first.pitch_px
    second = _wave(power / usual, f_y, f_x, allowed & (along < 0.5 * frequency))
    strong = second.clear >= max(CLEAR, HARMONIC * first.clear)
    return first, second if strong else None


def _wave(power: Array, f_y: Array, f_x: Array, allowed: Mask) -> Wave:
    """The strongest frequency; slower ones that are nearly as strong are the pitch, and it a
    harmonic of ticks.
    """
    strong = np.where(allowed, power, 0.0)
    top = strong.max()
    frequency = np.hypot(f_y, f_x)
    candidates = np.where(strong >= HARMONIC * top, frequency, np.inf)
    y, x = np.unravel_index(int(np.argmin(candidates)), candidates.shape)
    # from the flank of a line to its middle
    near = allowed & (np.hypot(f_y - f_y[y], f_x - f_x[x]) < 2.5 * max(1.0 / f_y.size, f_x[1]))
    y, x = np.unravel_index(int(np.argmax(np.where(near, power, 0.0))), power.shape)
    down, right = _between(power, int(y), int(x))
    step_y, step_x = 1.0 / f_y.size, float(f_x[1])
    return Wave(float(f_y[y, 0]) + down * step_y, float(f_x[x]) + right * step_x, float(top))


def _between(power: Array, y: int, x: int) -> tuple[float, float]:
    """How far from the middle of its bin a peak lies, along y and x.

    By a parabola through the logarithm, which the window's spectrum nearly is.
    """

    def at(down: int, right: int) -> float:
        row, column = y + down, x + right
        if column < 0:  # the other half of the plane
            row, column = -row, -column
        return float(np.log(max(power[row % power.shape[0], column], 1e-12)))

    def vertex(before: float, here: float, after: float) -> float:
        return 0.5 * (before - after) / min(before - 2.0 * here + after, -1e-12)

    here = at(0, 0)
    return vertex(at(-1, 0), here, at(1, 0)), vertex(at(0, -1), here, at(0, 1))


def _sides(first: Wave, second: Wave) -> tuple[tuple[float, float], tuple[float, float]]:
    """Along which squares lie that two diagonal waves make, in squares per pixel."""
    return ((first.y + second.y, first.x + second.x), (first.y - second.y, first.x - second.x))


def _is_checkerboard(picture: Array, first: Wave, second: Wave) -> bool:
    """Whether the picture is its own negative half a period of both waves further on."""
    waves = np.array([[first.y, first.x], [second.y, second.x]])
    y, x = np.rint(np.linalg.solve(waves, [0.5, 0.5])).astype(int)
    height, width = picture.shape
    here = picture[max(y, 0) : height + min(y, 0), max(x, 0) : width + min(x, 0)]
    there = picture[max(-y, 0) : height + min(-y, 0), max(-x, 0) : width + min(-x, 0)]
    return float(np.sum(here * there) / np.sqrt(np.sum(here**2) * np.sum(there**2))) < NEGATIVE
