"""The contact area of touches in a capacitive frame, by a laboratory's own pairs of frame and area.

The logarithm of the area is linear in those of two sizes of a touch's counts, in cells. Neither
depends on the gain of the counts. The calibration carries over to no other panel or pitch.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Annotated, NamedTuple

import numpy as np
from pydantic import Field
from scipy.ndimage import binary_dilation, find_objects, label, zoom

from haptic_driver.config import Section, Within
from haptic_driver.errors import BadInputError
from haptic_driver.lab.contact.judge import OUTSIDE
from haptic_driver.signals import Array, Mask

MERGED, CLIPPED, WEAK = "merged touches", "clipped counts", "weaker than any calibrated"
EDGE_SHARE = 0.1  # of the usual peak: where a touch ends
EXTENT_SHARE = 0.5  # of a touch's peak, as widths of peaks are told
VALLEYS = (0.3, 0.5, 0.7, 0.9)  # shares of the peak above which merged touches come apart
FINER = 8  # steps to a cell in which an extent is counted
CLIPPED_CELLS = 3  # noise makes fewer cells of a touch equally high
LEAST_TOUCHES = 12  # four for each coefficient
CHANCE = 2.0  # standard errors by which counts are better than a constant
NOISES = 5.0  # standard deviations of noise by which a touch's edge stands out
NEIGHBOURS = np.ones((3, 3), bool)

Counts = Annotated[float, Within(1e-9, 1e12, "no counts are finer or larger")]
Area = Annotated[float, Within(1e-8, 1e-2, "no finger touches with less or more")]


class Touch(NamedTuple):
    """A touch in a frame: its centre and sizes in cells, `bad` where it has no area and why.

    `extent_cells2` is the area above a share of the peak, `spread_cells2` the variance of the
    counts' place along rows and columns together.
    """

    row: float
    column: float
    peak_counts: float
    extent_cells2: float
    spread_cells2: float
    bad: str = ""


class Pairs(NamedTuple):
    """Touches with the areas that a camera saw, and whose finger each is."""

    touches: Sequence[Touch]
    area_m2: Array
    fingers: Sequence[str]


class PanelCalibration(Section):
    """What a panel's counts say of the area, for fingers like those that were calibrated.

    The errors are relative medians of fingers left out, of a single finger of touches left out.
    `constant_error` is that of the others' median area in place of an estimate.
    """

    shape: list[Annotated[int, Field(ge=3)]] = Field(min_length=2, max_length=2)
    edge_counts: Counts
    least_peak_counts: Counts
    coefficients: list[float] = Field(min_length=3, max_length=3)
    log_std: Annotated[float, Within(0.0, 3.0, "it is a spread of logarithms")]
    least_area_m2: Area
    most_area_m2: Area
    fingers: Annotated[int, Field(ge=1)]
    touches: Annotated[int, Field(ge=LEAST_TOUCHES)]
    error: Annotated[float, Field(ge=0.0)]
    constant_error: Annotated[float, Field(ge=0.0)]

    def seen(self, frame: Array) -> list[Touch]:
        """The touches of a frame [row, column]; BadInputError for one of another size."""
        if list(frame.shape) != self.shape:
            said = f"a frame is of {frame.shape} cells, the calibration of {tuple(self.shape)}"
            raise BadInputError("bad_frames", said, "Calibrate this panel, in this direction")
        found = find_touches(frame, self.edge_counts)
        weak = self.least_peak_counts
        return [t._replace(bad=WEAK) if not t.bad and t.peak_counts < weak else t for t in found]

    def area(self, touch: Touch) -> tuple[float, float]:
        """The contact area of a touch in m2, and its standard deviation."""
        area_m2 = float(np.exp(_terms([touch])[0] @ np.array(self.coefficients)))
        return area_m2, self.log_std * area_m2


def edge_counts(frames: Array) -> float:
    """Where touches end, by frames [n, row, column] that mostly have one; BadInputError.

    Counts rise under a touch, from near nothing: the bare panel is taken off.
    """
    level = frames - np.median(frames, axis=(1, 2), keepdims=True)
    high, low = np.median(level.max(axis=(1, 2))), -np.median(level.min(axis=(1, 2)))
    if low > high:
        said, hint = "counts fall under a touch", "Give the bare panel less the touched one"
        raise BadInputError("bad_frames", said, hint)
    noise = 1.4826 * float(np.median(np.abs(level)))
    if not EDGE_SHARE * high > NOISES * noise:
        said = f"touches of {high:g} counts do not stand out of {noise:.3g} counts of noise"
        raise BadInputError("bad_frames", said, "Take off the frame of the bare panel")
    return float(EDGE_SHARE * high)


def find_touches(frame: Array, edge: float) -> list[Touch]:
    """Every touch of a frame [row, column] that rises above its median by more than `edge`."""
    if not np.isfinite(frame).all():
        raise BadInputError("bad_frames", "a frame has cells without a number", "Leave it out")
    level = frame - np.median(frame)
    labels, count = label(level > edge, NEIGHBOURS)
    return [
        _touch(np.pad(level, 1), np.pad(labels, 1), number, place)
        for number, place in zip(range(1, count + 1), find_objects(labels), strict=True)
    ]


def _touch(level: Array, labels: Array, number: int, place: tuple[slice, ...]) -> Touch:
    """One of the labelled touches of a frame that is padded by a cell."""
    around = tuple(slice(one.start, one.stop + 2) for one in place)
    own = labels[around] == number
    reach = binary_dilation(own, NEIGHBOURS)
    counts = np.where(reach, np.maximum(level[around], 0.0), 0.0)
    row, column = np.indices(counts.shape)
    total, peak = counts.sum(), float(counts.max())
    y, x = float((counts * row).sum() / total), float((counts * column).sum() / total)
    spread = float((counts * ((row - y) ** 2 + (column - x) ** 2)).sum() / total)
    fine = zoom(np.pad(counts, 1), FINER, order=1, grid_mode=True, mode="nearest")
    extent = float((fine > EXTENT_SHARE * peak).sum()) / FINER**2
    at_edge = any(
        one.start == 0 or one.stop == size - 2 for one, size in zip(place, level.shape, strict=True)
    )
    bad = OUTSIDE if at_edge else _doubtful(counts, own, peak)
    return Touch(place[0].start + y - 1.0, place[1].start + x - 1.0, peak, extent, spread, bad)


def _doubtful(counts: Array, own: Mask, peak: float) -> str:
    if np.sum(counts[own] == peak) >= CLIPPED_CELLS:
        return CLIPPED
    parts = (label(own & (counts > share * peak), NEIGHBOURS)[1] for share in VALLEYS)
    return MERGED if any(count > 1 for count in parts) else ""


def calibrated(shape: Sequence[int], edge: float, pairs: Pairs) -> PanelCalibration:
    """The calibration by pairs of touch and area, each finger counting alike; BadInputError."""
    if len(pairs.touches) < LEAST_TOUCHES:
        said = f"{len(pairs.touches)} touches have an area, {LEAST_TOUCHES} are needed"
        raise BadInputError("too_few_touches", said, "Touch with several fingers and loads")
    log_area, terms = np.log(pairs.area_m2), _terms(pairs.touches)
    fingers = np.array(pairs.fingers)
    off, constant = np.zeros(log_area.size), np.zeros(log_area.size)
    for left in _left_out(fingers):
        off[left] = terms[left] @ _fit(terms[~left], log_area[~left], fingers[~left])
        constant[left] = np.median(log_area[~left])
    off, constant = off - log_area, constant - log_area
    error, constant_error = (float(np.median(np.abs(np.expm1(one)))) for one in (off, constant))
    gain = np.abs(constant) - np.abs(off)
    if not gain.mean() > CHANCE * gain.std(ddof=1) / np.sqrt(gain.size):
        said = f"by the counts areas are off by {error:.0%}, by their median {constant_error:.0%}"
        raise BadInputError("no_better", said, "Do areas differ, and are pairs of one time?")
    return PanelCalibration(
        shape=list(shape),
        edge_counts=edge,
        least_peak_counts=min(touch.peak_counts for touch in pairs.touches),
        coefficients=_fit(terms, log_area, fingers).tolist(),
        log_std=float(np.sqrt(np.mean(off**2))),
        least_area_m2=float(np.min(pairs.area_m2)),
        most_area_m2=float(np.max(pairs.area_m2)),
        fingers=len(set(pairs.fingers)),
        touches=len(pairs.touches),
        error=error,
        constant_error=constant_error,
    )


def _left_out(fingers: Array) -> Iterator[Mask]:
    """A finger at a time; of one finger a touch at a time."""
    names = np.unique(fingers)
    groups = fingers if names.size > 1 else np.arange(fingers.size)
    return (groups == one for one in np.unique(groups))


def _terms(touches: Sequence[Touch]) -> Array:
    sizes = np.array([(touch.extent_cells2, touch.spread_cells2) for touch in touches])
    return np.column_stack([np.ones(len(touches)), np.log(np.maximum(sizes, 1.0 / FINER**2))])


def _fit(terms: Array, log_area: Array, fingers: Array) -> Array:
    _, of, counts = np.unique(fingers, return_inverse=True, return_counts=True)
    weight = 1.0 / np.sqrt(counts[of])
    found = np.linalg.lstsq(terms * weight[:, None], log_area * weight, rcond=None)[0]
    return np.asarray(found)
