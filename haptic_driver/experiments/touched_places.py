"""Calibrating a touch screen by touching places that are known: whether a finger holds still, and
whether the touches agree.

Nothing here prints, opens or energises anything: the screen's reports, the clock and whoever tells
the user come from outside.
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
from hw.finger.touch_screen import RawTouch, TouchCalibration, fit_calibration
from model.support.tables import Table, read_table

HOLD_S = 0.5  # so long a finger must hold still; its place is the mean over that time
LIFT_S = 0.2  # so long it must be away: a contact that flickers is no lift
RESTLESS_S = 3.0  # a touch that has not held still for so long is told
POLL_S = 0.005
STILL_SHARE = 0.005  # of an axis: on a screen of 200 mm, 1 mm, as well as a finger can be placed
PLAUSIBLE_M = 2e-3  # what a finger misses a mark by; more is another place, or another unit
ALIKE = 0.8  # places that explain a disagreement almost as well as the best cannot be told from it

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


class Places(NamedTuple):
    """What a file says: `place_m` [n, 2]; where they have been touched already, with which counts,
    and the day of the first.
    """

    place_m: Array
    touched: list[TouchedPlace]
    measured_on: datetime.date | None


def read_places(path: Path) -> Places:
    """Places to touch, or with columns x_raw, y_raw, measured_at those touched; BadInputError says
    what is wrong.
    """
    table = read_table(path, ("x_m", "y_m"), WANTED)
    place_m = np.column_stack([_metres(table, "x_m"), _metres(table, "y_m")])
    _check_spread(path, place_m, "places")
    if not {"x_raw", "y_raw"} & set(table.columns):
        return Places(place_m, [], None)
    for column in ("x_raw", "y_raw", "measured_at"):
        table.require(column)
    raw = np.column_stack([table.numbers("x_raw"), table.numbers("y_raw")])
    days = [_day(table, row) for row in range(len(table.rows))]
    _check_spread(path, raw, "counts")
    touched = [TouchedPlace(*row) for row in np.hstack([place_m, raw]).tolist()]
    return Places(place_m, touched, min(days))


def _metres(table: Table, column: str) -> Array:
    values = table.numbers(column)
    too_large = np.flatnonzero(np.abs(values) > LARGEST_M)
    if too_large.size:
        i = int(too_large[0])
        said = f"{table.where(i)}: {column} = {values[i]:g} is out of range"
        raise BadInputError("bad_places", said, f"Give metres, at most {LARGEST_M:g}")
    return values


def _day(table: Table, row: int) -> datetime.date:
    text = table.rows[row]["measured_at"]
    try:
        return datetime.date.fromisoformat(text)
    except ValueError:
        said = f"{table.where(row)}: measured_at is {text!r}, not a date"
        raise BadInputError("bad_places", said, "Write the day as 2025-01-31") from None


def _check_spread(path: Path, points: Array, what: str) -> None:
    if len(points) < 3:
        raise BadInputError("bad_places", f"{path}: has {len(points)} {what}", WANTED)
    along, across = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    if across <= NARROWEST * along:
        raise BadInputError("bad_places", f"{path}: its {what} are on a line, or nearly", WANTED)


@dataclass(frozen=True)
class TouchFit:
    """A calibration, and how well the touches agree on it; places count from 0.

    `touch_error_m`: how far one touch is off, root mean square, from the residual and how much of
    it the fit took up; None for three places, which fit exactly. `off_m`: how far each place is
    from where all others put it, NaN where these are on a line. `suspects`: the places that, left
    out, make the others agree best; several where they cannot be told apart (with four places, all
    of them).
    """

    touched: list[TouchedPlace]
    calibration: TouchCalibration
    touch_error_m: float | None
    off_m: list[float]
    suspects: list[int]

    @property
    def agrees(self) -> bool:
        """Whether the touches are as close to one map as a finger is to a mark; True where nothing
        tells.
        """
        return self.touch_error_m is None or self.touch_error_m <= PLAUSIBLE_M


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
    if calibration.residual_m is None:
        return TouchFit(list(touched), calibration, None, [math.nan] * count, [])
    off_m, squares_m2 = np.array([_left_out(numbers, i, measured_on) for i in range(count)]).T
    gain_m2 = np.nan_to_num(count * calibration.residual_m**2 - squares_m2)
    suspects = np.flatnonzero(~np.isnan(off_m) & (gain_m2 >= ALIKE * gain_m2.max())).tolist()
    touch_error_m = calibration.residual_m * math.sqrt(count / (count - 3))
    return TouchFit(list(touched), calibration, touch_error_m, off_m.tolist(), suspects)


def _left_out(numbers: Array, i: int, measured_on: datetime.date) -> tuple[float, float]:
    """How far place i is from where the others put it, and the sum of squares of what these leave;
    NaN on a line.
    """
    others = np.delete(numbers, i, axis=0)
    try:
        fitted = fit_calibration(others[:, 2:], others[:, :2], measured_on)
    except ValueError:
        return math.nan, math.nan
    off_m = math.dist(fitted.apply(*numbers[i, 2:]), numbers[i, :2])
    return off_m, len(others) * (fitted.residual_m or 0.0) ** 2


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
    """Have each place touched in turn, and those once more that disagree; the fit may still not
    agree.

    `read` gives the screen's newest report without waiting; `tell` gets what the user should know.
    Raises what `read` raises, and HapticError as `fit_touches`.
    """
    touched: dict[int, TouchedPlace] = {}

    def touch(number: int, request: str) -> None:
        x_m, y_m = place_m[number].tolist()
        where = f"x = {1e3 * x_m:.1f} mm, y = {1e3 * y_m:.1f} mm"
        tell(f"{request} place {number + 1} of {len(place_m)}: {where}")
        place = TouchedPlace(x_m, y_m, *_held(read, spread_raw, tell, clock, sleep))
        _check_moved(number, place, touched, spread_raw)
        touched[number] = place

    for number in range(len(place_m)):
        touch(number, "touch")
    found = fit_touches([*touched.values()], measured_on)
    if found.agrees:
        return found
    for number in found.suspects:
        off_mm = 1e3 * found.off_m[number]
        touch(number, f"{off_mm:.1f} mm off where the others put it; touch again")
    return fit_touches([*touched.values()], measured_on)


def _check_moved(
    number: int,
    place: TouchedPlace,
    touched: dict[int, TouchedPlace],
    spread_raw: tuple[float, float],
) -> None:
    """Two places at the same counts would make a map of noise, and three places fit whatever was
    touched.
    """
    for other, earlier in touched.items():
        near = np.abs(np.subtract(place[2:], earlier[2:])) <= spread_raw
        if near.all() and other != number and place[:2] != earlier[:2]:
            said = (
                f"place {number + 1} was touched where place {other + 1} was: the counts are the"
                " same"
            )
            raise HapticError(
                "same_counts", said, "Run it again, and touch each place when it is asked for"
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


def rows_of(found: TouchFit) -> list[dict[str, str | float]]:
    """Rows of a file that `read_places` takes for touched."""
    day = found.calibration.measured_on.isoformat()
    return [{**place._asdict(), "measured_at": day} for place in found.touched]


def matrix_of(calibration: TouchCalibration) -> list[list[float]]:
    """`matrix_m` as it is written: to nine digits, far below a count."""
    return [[float(f"{value:.9g}") for value in row] for row in calibration.matrix_m]


def rig_lines(calibration: TouchCalibration) -> str:
    """What `[finger_tracker]` of a rig's file should say, as TOML."""
    day = calibration.measured_on.isoformat()
    return f"matrix_m = {matrix_of(calibration)}\nmeasured_at = {day}\nplaceholder = false"
