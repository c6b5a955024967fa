"""Calibrating a touch screen by touching places that are known: whether a finger holds still, and
whether the touches agree.

Nothing here prints, opens or energises anything: the screen's reports, the clock and the messages
to the user come from outside.
"""

from __future__ import annotations

import datetime
import math
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from haptic_driver.errors import BadInputError, HapticError
from haptic_driver.signals import Array
from hw.finger.touch_screen import RawTouch, TouchCalibration
from model.support.tables import Table, read_table

HOLD_S = 0.5  # so long a finger must hold still; its place is the mean over that time
LIFT_S = 0.2  # so long it must be away: a contact that flickers is no lift
RESTLESS_S = 3.0  # a touch that has not held still for so long is reported
POLL_S = 0.005
STILL_SHARE = 0.005  # of an axis: on a screen of 200 mm, 1 mm, as well as a finger can be placed
PLAUSIBLE_M = 2e-3  # what a finger misses a mark by; more is another place, or another unit

LARGEST_M = 2.0  # beyond, the unit must be wrong
NARROWEST = 0.05  # how far from a line places must be, against their length along it
WANTED = (
    "Give a CSV with columns x_m, y_m: at least 3 places not on a line, better corners, middle and"
    " edges"
)


class TouchedPlace(NamedTuple):
    """A place on the screen, and the counts of a finger that held still there."""

    x_m: float
    y_m: float
    x_raw: float
    y_raw: float


def read_places(path: Path) -> Array:
    """Places to touch: [n, 2]. BadInputError says what is wrong."""
    table = read_table(path, ("x_m", "y_m"), WANTED)
    place_m = np.column_stack([_metres(table, "x_m"), _metres(table, "y_m")])
    if len(place_m) < 3:
        raise BadInputError("bad_places", f"{path}: has {len(place_m)} places", WANTED)
    along, across = np.linalg.svd(place_m - place_m.mean(axis=0), compute_uv=False)
    if across <= NARROWEST * along:
        raise BadInputError("bad_places", f"{path}: its places are on a line, or nearly", WANTED)
    return place_m


def _metres(table: Table, column: str) -> Array:
    values = table.numbers(column)
    too_large = np.flatnonzero(np.abs(values) > LARGEST_M)
    if too_large.size:
        i = int(too_large[0])
        said = f"{table.where(i)}: {column} = {values[i]:g} is out of range"
        raise BadInputError("bad_places", said, f"Give metres, at most {LARGEST_M:g}")
    return values


@dataclass(frozen=True)
class TouchFit:
    """A calibration, and how well the touches agree on it.

    `touch_error_m`: how far one touch is off, root mean square, from the residual and how much of
    it the fit took up. None for three places, which fit exactly. `off_m`: how far the map puts each
    touch from its place.
    """

    touched: list[TouchedPlace]
    calibration: TouchCalibration
    touch_error_m: float | None
    off_m: list[float]

    @property
    def agrees(self) -> bool:
        """Whether the touches are as close to one map as a finger is to a mark; True where the data
        cannot show it.
        """
        return self.touch_error_m is None or self.touch_error_m <= PLAUSIBLE_M

    @property
    def worst(self) -> int:
        """Index of the touch that is farthest off."""
        return int(np.argmax(self.off_m))


def fit_touches(touched: Sequence[TouchedPlace], measured_on: datetime.date) -> TouchFit:
    """The least-squares calibration. HapticError where the counts tell no map of a plane."""
    numbers, count = np.array(touched), len(touched)
    try:
        calibration = fit_calibration(numbers[:, 2:], numbers[:, :2], measured_on)
    except ValueError as error:
        said = f"the counts of the {count} touches are on a line, and the places are not"
        raise HapticError(
            "touches_on_a_line", said, "Touch each place as it is asked for"
        ) from error
    off_m = [math.dist(calibration.apply(*place[2:]), place[:2]) for place in touched]
    residual_m = calibration.residual_m
    error_m = None if residual_m is None else residual_m * math.sqrt(count / (count - 3))
    return TouchFit(list(touched), calibration, error_m, off_m)


def fit_calibration(raw: Array, position_m: Array, measured_on: datetime.date) -> TouchCalibration:
    """Least-squares calibration from points touched, `raw` [n, 2] in counts, at places known,
    `position_m` [n, 2].

    Needs three points or more that are not on a line; from four on, the residual says how well they
    agree. Raises ValueError.
    """
    raw, position_m = np.asarray(raw, dtype=np.float64), np.asarray(position_m, dtype=np.float64)
    if raw.ndim != 2 or raw.shape[1:] != (2,) or raw.shape != position_m.shape or len(raw) < 3:
        raise ValueError(
            f"give [n, 2] of each, n at least 3; got {raw.shape} and {position_m.shape}"
        )
    if not (np.isfinite(raw).all() and np.isfinite(position_m).all()):
        raise ValueError("calibration points must be numbers")
    centre = raw.mean(axis=0)
    spread = float(np.abs(raw - centre).max()) or 1.0
    design = np.column_stack([(raw - centre) / spread, np.ones(len(raw))])
    if np.linalg.svd(design, compute_uv=False)[-1] < 1e-3:
        raise ValueError("calibration points are on a line; touch points in three corners or more")
    fitted = np.linalg.lstsq(design, position_m, rcond=None)[0]
    slope = fitted[:2].T / spread
    matrix = np.column_stack([slope, fitted[2] - slope @ centre])
    residual_m = float(np.sqrt(np.mean(np.sum((design @ fitted - position_m) ** 2, axis=1))))
    rows = [(float(a), float(b), float(c)) for a, b, c in matrix]
    return TouchCalibration(
        (rows[0], rows[1]), measured_on, False, residual_m if len(raw) > 3 else None
    )


def touch_places(
    place_m: Array,
    read: Callable[[], RawTouch],
    spread_raw: tuple[float, float],
    tell: Callable[[str], None],
    measured_on: datetime.date,
    *,
    clock: Callable[[], float],
    sleep: Callable[[float], None],
) -> TouchFit:
    """Have each place touched in turn; the touches may still not agree.

    `read` gives the screen's newest report without waiting; `tell` gets what the user should know.
    Raises what `read` raises, and HapticError as `fit_touches`.
    """
    touched: list[TouchedPlace] = []
    for number, (x_m, y_m) in enumerate(place_m.tolist(), start=1):
        where = f"x = {1e3 * x_m:.1f} mm, y = {1e3 * y_m:.1f} mm"
        tell(f"touch place {number} of {len(place_m)}: {where}")
        place = TouchedPlace(x_m, y_m, *_held(read, spread_raw, tell, clock, sleep))
        _check_moved(place, touched, spread_raw)
        touched.append(place)
    return fit_touches(touched, measured_on)


def _check_moved(
    place: TouchedPlace, touched: list[TouchedPlace], spread_raw: tuple[float, float]
) -> None:
    """Two places at the same counts would make a map of noise, and three places fit whatever was
    touched.
    """
    for other, earlier in enumerate(touched, start=1):
        near = np.abs(np.subtract(place[2:], earlier[2:])) <= spread_raw
        if near.all() and place[:2] != earlier[:2]:
            number = len(touched) + 1
            raise HapticError(
                "same_counts",
                f"place {number} was touched where place {other} was: the counts are the same",
                "Run it again, and touch each place when it is asked for",
            )


def _held(
    read: Callable[[], RawTouch],
    spread_raw: tuple[float, float],
    tell: Callable[[str], None],
    clock: Callable[[], float],
    sleep: Callable[[float], None],
) -> tuple[float, float]:
    """The counts of the next touch that holds still within `spread_raw`, once it has been lifted.

    A finger at rest causes no reports, so what was last reported counts for as long as nothing else
    is.
    """
    recent: deque[tuple[float, int, int]] = deque()
    began_s, told = math.nan, False
    while True:
        now_s, touch = clock(), read()
        if touch.touching:
            if not recent:
                began_s, told = now_s, False
            recent.append((now_s, touch.x_raw, touch.y_raw))
            while len(recent) > 1 and recent[1][0] <= now_s - HOLD_S:
                recent.popleft()
            counts = np.array(recent)[:, 1:]
            moved_x, moved_y = np.ptp(counts, axis=0)
            if now_s - recent[0][0] >= HOLD_S:
                if moved_x <= spread_raw[0] and moved_y <= spread_raw[1]:
                    break
                if now_s - began_s >= RESTLESS_S and not told:
                    told = True
                    tell(
                        f"  it moves by {moved_x:.0f} x {moved_y:.0f} counts: hold still, or give"
                        " more with --spread-raw"
                    )
        elif recent:
            recent.clear()
            tell(f"  lifted too early: hold it for {HOLD_S:g} s")
        sleep(POLL_S)
    x_raw, y_raw = np.round(counts.mean(axis=0), 3).tolist()  # as they are written
    tell(f"  held at {x_raw:.1f}, {y_raw:.1f} counts; lift")
    touched_s = clock()
    while clock() - touched_s < LIFT_S:
        sleep(POLL_S)
        if read().touching:
            touched_s = clock()
    return x_raw, y_raw


def matrix_of(calibration: TouchCalibration) -> list[list[float]]:
    """`matrix_m` as it is written: to nine digits, far below a count."""
    return [[float(f"{value:.9g}") for value in row] for row in calibration.matrix_m]


def rig_lines(calibration: TouchCalibration) -> str:
    """What `[finger_tracker]` of a rig's file should say, as TOML."""
    day = calibration.measured_on.isoformat()
    return f"matrix_m = {matrix_of(calibration)}\nmeasured_at = {day}\nplaceholder = false"
