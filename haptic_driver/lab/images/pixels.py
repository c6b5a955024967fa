"""What a file holds of one picture, and what share of full scale that is."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from haptic_driver.errors import BadInputError
from haptic_driver.signals import Array

# bits of the sensors whose counts are stored in wider numbers
SENSOR_BITS = (8, 10, 12, 14, 16)
# of red, green and blue: ITU-R BT.709, item 3.2
LUMINANCE = (0.2126, 0.7152, 0.0722)
# conventions of maps for a place without a number, where the lowest value stands apart by it
NO_DATA = (-32768.0, -32767.0, -9999.0, -99999.0)
BYTE = 255.0
# of a pixel's sides: resolutions in whole dots per inch or metre differ by less
LEAST_ASPECT = 0.01
# larger floats are conventions too, of several programs
LARGEST = 1e30


@dataclass(frozen=True)
class Pixels:
    """Grey values [y, x] as stored, NaN where there is none.

    `full` is the most that the format holds. It is None of floats, of signed numbers and of more
    than 16 bits, which do not say what is white. `said` is what was done to get them.
    """

    values: Array
    full: float | None
    white_is_zero: bool = False
    said: tuple[str, ...] = ()

    @property
    def top(self) -> float:
        """The largest value, whatever its sign; 0 where there is none."""
        return float(np.nanmax(np.abs(self.values), initial=0.0))


def of_array(image: Any, no_data: float | None = None) -> Pixels:
    """Pixels of an array [y, x] or of colours [y, x, 3], its type being the format."""
    stored = np.asarray(image)
    full = _most(stored.dtype)
    values = stored.astype(np.float64)
    if values.ndim == 3:
        values = values[..., :3] @ LUMINANCE if values.shape[2] >= 3 else values[..., 0]
    if values.ndim != 2:
        said = f"a picture has the shape {stored.shape}"
        raise BadInputError("bad_image", said, "Give rows and columns, grey or of colours")
    return Pixels(_without_blanks(values, no_data) if full is None else values, full)


def full_scale(pictures: Iterable[Pixels]) -> float:
    """What white is for pictures of one origin: the depth of a sensor that holds all their values.

    Counts of 12 bits in numbers of 16 have 4095. Where the format says nothing it is the largest
    value.
    """
    top, full = 0.0, None
    for one in pictures:
        top, full = max(top, one.top), one.full
    if full is None:
        return top or 1.0
    usual = (2.0**bits - 1.0 for bits in SENSOR_BITS)
    return min(each for each in (*usual, full) if min(top, full) <= each <= full)


def shares(pixels: Pixels, full: float | None = None) -> Array:
    """Shares [y, x] of full scale, bright being 1; what has no number takes the nearest pixel's.

    Negative values stay. BadInputError for a picture half of which has no numbers.
    """
    white = full_scale([pixels]) if full is None else full
    share = filled(pixels.values) / white
    return 1.0 - share if pixels.white_is_zero else share


def filled(values: Array) -> Array:
    """The same with the nearest number in each pixel that has none."""
    from scipy.ndimage import distance_transform_edt  # noqa: PLC0415  (slow to import)

    missing = np.isnan(values)
    if not missing.any():
        return values
    if missing.mean() > 0.5:
        said = f"{missing.mean():.0%} of a picture's pixels have no number"
        raise BadInputError("no_numbers", said, "Cut out the part that has numbers")
    nearest = distance_transform_edt(missing, return_distances=False, return_indices=True)
    return np.asarray(values[tuple(nearest)])


def told(pixels: Pixels, full: float) -> list[str]:
    """What was done to get shares of `full`, in words."""
    said = list(pixels.said)
    missing = float(np.isnan(pixels.values).mean())
    if missing:
        said.append(f"{100.0 * missing:.2g} % of the pixels have no number: the nearest is taken")
    if pixels.white_is_zero:
        said.append("0 is white, as the file says")
    if pixels.full is not None and pixels.full > BYTE:
        said += _lonely_ends(pixels.values, pixels.full)
    if pixels.full is not None and full != pixels.full:
        said.append(f"full scale is {full:g} of the {pixels.full:g} that the file could hold")
    return said


def aspect_told(wide: float, high: float) -> list[str]:
    """That pixels are not square, where a file says how wide and how high one is."""
    if not (wide > 0.0 and high > 0.0) or abs(wide / high - 1.0) < LEAST_ASPECT:
        return []
    return [f"a pixel is {wide / high:.3g} times as wide as high by the file: taken as square"]


def _lonely_ends(values: Array, full: float) -> list[str]:
    """Whether an end of the format stands apart, as where heights are not known."""
    said = []
    for end in (0.0, full):
        at_end = values == end
        others = values[~at_end]
        if at_end.any() and others.size and np.abs(others - end).min() > np.ptp(others) > 0.0:
            share = f"{100.0 * at_end.mean():.2g} % of the pixels are {end:g}"
            said.append(f"{share}, far from all others: if that means no number, cut them out")
    return said


def _most(kind: np.dtype[Any]) -> float | None:
    if kind.kind == "b":
        return 1.0
    return float(np.iinfo(kind).max) if kind.kind == "u" and kind.itemsize <= 2 else None


def _without_blanks(values: Array, no_data: float | None) -> Array:
    """NaN for what says that there is no number."""
    blank = ~(np.abs(values) < LARGEST)
    if no_data is not None:
        blank |= values == no_data
    rest = values[~blank]
    if rest.size and float(rest.min()) in NO_DATA:
        others = rest[rest > rest.min()]
        if others.size and others.min() - rest.min() > np.ptp(others):
            blank |= values == rest.min()
    return np.where(blank, np.nan, values)
