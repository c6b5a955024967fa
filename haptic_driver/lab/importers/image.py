"""A picture as people have it -> friction: any kind of file, its contrast stretched, by one of
three mappings.

`luminance`: bright is rough. `height`: bright is high, and friction goes with the slope that a
stroke meets. Participants preferred that for bumps on a flat screen (Kim, Israr & Poupyrev, Tactile
rendering of 3D features on touch surfaces, UIST 2013, doi 10.1145/2501988.2502020). There the slope
is mapped to lateral force, which is friction times the load. `edges`: where the picture changes
there is a bump, whichever way it is crossed (a choice of this driver).
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np
from PIL import Image

from haptic_driver.errors import BadInputError
from haptic_driver.lab.images.files import opened
from haptic_driver.lab.images.pixels import full_scale, shares, told
from haptic_driver.signals import Array
from haptic_driver.textures.bands import Output, finger_gain
from haptic_driver.textures.description import FINEST_MM

Method = Literal["luminance", "height", "edges"]
MOST_MAP_PIXELS = 2_000_000  # what render takes
PERCENTILES = (2.0, 98.0)  # of brightness, which become the ends: a speck is no measure of contrast
STEEPEST = 98.0  # percentile of slopes and edges that counts as the most
LEAST_CONTRAST = 1e-3  # of full scale: less is noise
SMOOTH_MM = 0.2  # of slopes and edges: a camera's grain has a slope too


class Picture(NamedTuple):
    """Brightness [row, column] from 0 to 1, at pixels of `pitch_mm`, and what was done to it."""

    bright: Array
    pitch_mm: float
    done: list[str]


def read_picture(path: Path, width_mm: float) -> Picture:
    """Any picture, upright, grey, as fine as is felt. BadInputError for a film, and for what is
    none.
    """
    with opened(path) as pictures:
        if pictures.count != 1:
            said = f"{path} holds {pictures.count} pictures"
            raise BadInputError("several_pictures", said, "save the one that is meant by itself")
        pixels = pictures.read(0)
        full = full_scale([pixels])
        done = [*pictures.said, *told(pixels, full)]
    bright = shares(pixels, full)
    if pixels.full is None:
        bright = (bright - bright.min()) / (np.ptp(bright) or 1.0)
        ends = float(np.nanmin(pixels.values)), float(np.nanmax(pixels.values))
        black, white = reversed(ends) if pixels.white_is_zero else ends
        done.append(f"black is {black:.4g} and white {white:.4g}, the least and the most in it")
    rows, columns = bright.shape
    pitch_mm = max(width_mm / columns, FINEST_MM)
    wide = max(round(width_mm / pitch_mm), 1)
    high = max(round(rows * wide / columns), 1)
    if wide * high > MOST_MAP_PIXELS:
        said = f"{path} at {width_mm:g} mm has {wide} x {high} places of {FINEST_MM:g} mm"
        raise BadInputError("map_too_large", said, "make it narrower, or cut it")
    if (wide, high) != (columns, rows):
        fine = Image.fromarray(bright.astype(np.float32))
        bright = np.asarray(fine.resize((wide, high), Image.Resampling.BOX), dtype=float)
        done.append(f"averaged from {columns} x {rows} to {wide} x {high} pixels")
    return Picture(bright, width_mm / wide, done)


class Mapped(NamedTuple):
    """How far [row, column] from the lower friction, 0, to the higher, 1.

    It comes of brightness `bright`, which is cut at `ends`; `done` has all that was done.
    """

    shares: Array
    bright: Array
    ends: tuple[float, float]
    done: list[str]


def friction_shares(
    picture: Picture, method: Method, direction_deg: float, percentiles: tuple[float, float]
) -> Mapped:
    """Brightness, stretched between percentiles, by one of the mappings; BadInputError where there
    is none.
    """
    low, high = (float(end) for end in np.percentile(picture.bright, percentiles))
    if high - low < LEAST_CONTRAST:
        said = f"the picture has no contrast: {low:.3g} to {high:.3g} of full brightness"
        raise BadInputError("no_contrast", said, "give another, or wider --percentiles")
    stretched = np.clip((picture.bright - low) / (high - low), 0.0, 1.0)
    words = " and ".join(f"{p:g} %" for p in percentiles)
    done = [f"brightness {low:.2f} to {high:.2f} (percentiles {words}) stretched to 0 to 1"]
    mapped, how = _mapped(stretched, picture.pitch_mm, method, direction_deg)
    return Mapped(mapped, picture.bright, (low, high), [*picture.done, *done, how])


def _mapped(
    bright: Array, pitch_mm: float, method: Method, direction_deg: float
) -> tuple[Array, str]:
    if method == "luminance":
        return bright, "bright is high friction"
    along_x, along_y = _slopes(bright, pitch_mm)
    if method == "edges":
        steep = np.hypot(along_x, along_y)
        return np.clip(steep / _most(steep), 0.0, 1.0), "edges are high friction"
    angle = math.radians(direction_deg)
    slope = along_x * math.cos(angle) + along_y * math.sin(angle)
    way = f"the slope of brightness as height, for strokes towards {direction_deg:g} degrees"
    shares = 0.5 + 0.5 * np.clip(slope / _most(np.abs(slope)), -1.0, 1.0)
    return shares, f"{way}: uphill is high friction (doi 10.1145/2501988.2502020)"


def rendered(
    cof: Array, pitch_m: float, speed_m_s: float, reachable_cof: tuple[float, float], output: Output
) -> Array:
    """Friction [row, column] that arrives at a usual finger on strokes along x at a speed. It is
    within reach, and less what the output and the finger's own lag lose.
    """
    wide = cof.shape[1]
    reached = np.clip(cof, *reachable_cof)
    both_ways = np.concatenate([reached, reached[:, ::-1]], axis=1)  # ends without a step
    frequency_hz = np.asarray(np.fft.rfftfreq(2 * wide, pitch_m) * speed_m_s, np.float64)
    gain = output.gain(frequency_hz) * finger_gain(frequency_hz, speed_m_s)
    felt = np.fft.irfft(np.fft.rfft(both_ways, axis=1) * gain, 2 * wide, axis=1)
    return np.asarray(felt[:, :wide])


def save_grey(shares: Array, path: Path) -> None:
    """As 16-bit grey PNG, which is finer than any friction that is felt."""
    from haptic_driver.files import replacing  # noqa: PLC0415

    levels = np.round(65535.0 * shares).astype(np.uint16)
    with replacing(path) as part:
        Image.fromarray(levels).save(part, format="PNG")


def _slopes(height: Array, pitch_mm: float) -> tuple[Array, Array]:
    """Along x and along y, smoothed; a picture one pixel wide has none that way."""
    from scipy.ndimage import gaussian_filter  # noqa: PLC0415

    sigma = SMOOTH_MM / pitch_mm
    return tuple(
        gaussian_filter(height, sigma, order, mode="nearest") for order in ((0, 1), (1, 0))
    )


def _most(steep: Array) -> float:
    """What counts as the most: of few lines on an even ground a percentile would be nothing."""
    known = steep[steep > 0.05 * steep.max()] if steep.max() > 0.0 else steep
    return max(float(np.percentile(known, STEEPEST)), 1e-12)
