"""Calibrating a touch screen by touching places that are known: who is asked what, and whether the
touches agree.

Nothing here prints, opens or energises anything: the screen's reports, the clock and whoever asks
the user come from outside.
"""

from __future__ import annotations

import datetime
import enum
import math
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from haptic_driver.errors import BadInputError, HapticError
from haptic_driver.files import bad_input
from haptic_driver.signals import Array
from hw.finger.touch_screen import RawTouch, TouchCalibration, fit_calibration
from model.support.tables import Table, read_table

HOLD_S = 0.5  # so long a finger must hold still; its place is the mean over that time
LIFT_S = 0.2  # so long it must be away: a contact that flickers is no lift
RESTLESS_S = 3.0  # a touch that has not held still for so long is told
POLL_S = 0.005
STILL_SHARE = 0.005  # of an axis: on a screen of 200 mm, 1 mm, as well as a finger can be placed
PLAUSIBLE_M = 2e-3  # what a finger misses a mark by; more is another place, or another unit
ROUNDS = 2  # what disagrees is asked for once more
ALIKE = 0.8  # places that explain a disagreement almost as well as the best cannot be told from it

COUNTS = ("x_raw", "y_raw", "measured_at")
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


@dataclass(frozen=True)
class Places:
    """What a file says: `place_m` [n, 2]; `raw` [n, 2] and the day where it has been touched
    already.
    """

    place_m: Array
    raw: Array | None = None
    measured_on: datetime.date | None = None

    def touched(self) -> list[TouchedPlace]:
        """The places with their counts; none where they are not known."""
        return (
            []
            if self.raw is None
            else [TouchedPlace(*map(float, row)) for row in np.hstack([self.place_m, self.raw])]
        )


def read_places(path: Path) -> Places:
    """Places to touch, or with columns x_raw, y_raw, measured_at those touched; BadInputError says
    what is wrong.
    """
    with bad_input():
        table = read_table(path, ("x_m", "y_m"), WANTED)
        place_m = np.column_stack([_metres(table, "x_m"), _metres(table, "y_m")])
        if not {"x_raw", "y_raw"} & set(table.columns):
            _check_spread(path, place_m, "places")
            return Places(place_m)
        for column in COUNTS:
            table.require(column)
        raw = np.column_stack([table.numbers("x_raw"), table.numbers("y_raw")])
        days = [_day(table, row) for row in range(len(table.rows))]
    _check_spread(path, place_m, "places")
    _check_spread(path, raw, "counts")
    return Places(place_m, raw, min(days))  # as old as its oldest touch


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


# --- whether the touches agree
# ---------------------------------------------------------------------------------


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
    numbers = np.array(touched)
    place_m, raw = numbers[:, :2], numbers[:, 2:]
    try:
        calibration = fit_calibration(raw, place_m, measured_on)
    except ValueError as error:
        said = f"the counts of the {len(touched)} touches are on a line, and the places are not"
        raise HapticError(
            "touches_on_a_line", said, "Touch each place as it is asked for"
        ) from error
    count = len(touched)
    if calibration.residual_m is None:
        return TouchFit(list(touched), calibration, None, [math.nan] * count, [])
    left_m, free = _left_over(raw, place_m)
    told = free > 1e-6
    off_m = np.where(told, left_m / np.where(told, free, 1.0), math.nan)
    gain = np.where(
        told, left_m * np.nan_to_num(off_m), 0.0
    )  # by how much the sum of squares falls without it
    suspects = [int(i) for i in np.flatnonzero(told & (gain >= ALIKE * gain.max()))]
    touch_error_m = calibration.residual_m * math.sqrt(count / (count - 3))
    return TouchFit(
        list(touched), calibration, touch_error_m, [float(off) for off in off_m], suspects
    )


def _left_over(raw: Array, place_m: Array) -> tuple[Array, Array]:
    """Per place the distance that the fit leaves, and its share that the place has not pulled the
    fit by (0 to 1).
    """
    design = np.column_stack([(raw - raw.mean(axis=0)) / raw.std(axis=0).max(), np.ones(len(raw))])
    basis = np.linalg.qr(design)[0]
    left = place_m - basis @ (basis.T @ place_m)
    return np.hypot(left[:, 0], left[:, 1]), np.asarray(1.0 - np.sum(basis**2, axis=1))


# --- touching
# --------------------------------------------------------------------------------------------------


class Moment(enum.Enum):
    """What the user should know while places are touched."""

    TOUCH = "touch this place"
    AGAIN = "touch this place again: it disagrees with the others"
    LIFTED_EARLY = "lifted before it had held still"
    RESTLESS = "does not hold still"
    HELD = "held still: lift"


class Step(NamedTuple):
    """A moment at place `number` (from 0); `raw` are its counts once held, or how far it moved
    while it should not.

    `off_m` is how far a place to touch again was from where the others put it.
    """

    moment: Moment
    number: int
    raw: tuple[float, float] = (math.nan, math.nan)
    off_m: float = math.nan


class HeldTouch:
    """Follows a finger at one place through the screen's reports: held still within `spread_raw`,
    then lifted.

    A finger at rest causes no reports, so what was last reported counts for as long as nothing else
    is.
    """

    def __init__(self, spread_raw: tuple[float, float]) -> None:
        self.raw: tuple[float, float] | None = None  # once held
        self.moved_raw = (0.0, 0.0)  # within the last HOLD_S
        self._spread_raw = spread_raw
        self._recent: deque[tuple[float, int, int]] = deque()
        self._began_s: float | None = None
        self._told = False
        self._lifted_s: float | None = None

    def take(self, now_s: float, touch: RawTouch) -> Moment | None:
        """The newest report, as of now; what the user should know, if anything new."""
        if touch.touching:
            self._lifted_s = None
            return None if self.raw is not None else self._follow(now_s, touch)
        if self._lifted_s is None:
            self._lifted_s = now_s
        early = self._began_s is not None and self.raw is None
        self._began_s = None
        self._recent.clear()
        return Moment.LIFTED_EARLY if early else None

    def is_over(self, now_s: float) -> bool:
        """Whether it was held, and then lifted for long enough."""
        return (
            self.raw is not None and self._lifted_s is not None and now_s - self._lifted_s >= LIFT_S
        )

    def _follow(self, now_s: float, touch: RawTouch) -> Moment | None:
        if self._began_s is None:
            self._began_s, self._told = now_s, False
        self._recent.append((now_s, touch.x_raw, touch.y_raw))
        while len(self._recent) > 1 and self._recent[1][0] <= now_s - HOLD_S:
            self._recent.popleft()
        if now_s - self._recent[0][0] < HOLD_S:
            return None
        counts = np.array(self._recent)[:, 1:]
        x_raw, y_raw = np.ptp(counts, axis=0)
        self.moved_raw = float(x_raw), float(y_raw)
        if x_raw <= self._spread_raw[0] and y_raw <= self._spread_raw[1]:
            x_raw, y_raw = counts.mean(axis=0)
            self.raw = round(float(x_raw), 3), round(float(y_raw), 3)  # as they are written
            return Moment.HELD
        if now_s - self._began_s >= RESTLESS_S and not self._told:
            self._told = True
            return Moment.RESTLESS
        return None


def touch_places(
    place_m: Array,
    read: Callable[[], RawTouch],
    spread_raw: tuple[float, float],
    tell: Callable[[Step], None],
    measured_on: datetime.date,
    *,
    clock: Callable[[], float] = time.monotonic,
    sleep: Callable[[float], None] = time.sleep,
) -> TouchFit:
    """Have each place touched in turn, and those once more that disagree; the fit may still not
    agree.

    `read` gives the screen's newest report without waiting. Raises what it raises, and HapticError
    as `fit_touches`.
    """
    touched: dict[int, TouchedPlace] = {}
    asked = [Step(Moment.TOUCH, number) for number in range(len(place_m))]
    for _ in range(ROUNDS):
        for step in asked:
            tell(step)
            x_m, y_m = map(float, place_m[step.number])
            place = TouchedPlace(
                x_m, y_m, *_held(step.number, read, spread_raw, tell, clock, sleep)
            )
            _check_moved(step.number, place, touched, spread_raw)
            touched[step.number] = place
        found = fit_touches([touched[number] for number in range(len(place_m))], measured_on)
        if found.agrees:
            break
        asked = [Step(Moment.AGAIN, number, off_m=found.off_m[number]) for number in found.suspects]
    return found


def _check_moved(
    number: int,
    place: TouchedPlace,
    touched: Mapping[int, TouchedPlace],
    spread_raw: tuple[float, float],
) -> None:
    """Two places at the same counts would make a map of noise, and three places fit whatever was
    touched.
    """
    for other, before in touched.items():
        near = (
            abs(place.x_raw - before.x_raw) <= spread_raw[0]
            and abs(place.y_raw - before.y_raw) <= spread_raw[1]
        )
        if near and other != number and place[:2] != before[:2]:
            said = (
                f"place {number + 1} was touched where place {other + 1} was: the counts are the"
                " same"
            )
            raise HapticError(
                "same_counts", said, "Run it again, and touch each place when it is asked for"
            )


def _held(
    number: int,
    read: Callable[[], RawTouch],
    spread_raw: tuple[float, float],
    tell: Callable[[Step], None],
    clock: Callable[[], float],
    sleep: Callable[[float], None],
) -> tuple[float, float]:
    """The counts of the next touch that holds still, once it has been lifted."""
    finger = HeldTouch(spread_raw)
    while finger.raw is None or not finger.is_over(clock()):
        moment = finger.take(clock(), read())
        if moment is not None:
            tell(Step(moment, number, finger.raw or finger.moved_raw))
        sleep(POLL_S)
    return finger.raw


# --- what is kept
# ----------------------------------------------------------------------------------------------


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
