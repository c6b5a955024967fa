"""Where the finger is on the touch screen: what every tracker tells; a finger on a stage, and a
recorded one.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from hw.errors import DeviceError, DeviceTimeout
from hw.stage.lts150 import StageStatus
from hw.transport.running import Running

Array = NDArray[np.float64]

STALE_AFTER_S = 0.2


class FingerReading(NamedTuple):
    """One reading: when the position was true (CLOCK_MONOTONIC), the position in screen
    coordinates, and touch.

    Before the first touch the position is NaN; after a lift it is the last one. `contacts` counts
    all fingers and palms on the screen, None where it tells one alone; `palm` is among them.
    `contact_area_m2` is that of this finger, with its standard deviation; NaN where it is not told.
    """

    time_s: float
    position_x_m: float
    position_y_m: float
    touching: bool
    contacts: int | None = None
    palm: bool = False
    contact_area_m2: float = math.nan
    contact_area_std_m2: float = math.nan


class FingerTracker(Protocol):
    """A source of finger positions."""

    def read(self) -> FingerReading:
        """Return the newest reading without waiting. Raises DeviceError."""


class StageFinger(Running):
    """A finger carried by a stage: its position on a line across the screen, polled in a thread of
    its own.

    `origin_m` is the place on the screen at stage position 0, `direction` the unit vector of a move
    forward. `touching` says only that the position is known (the stage is homed): contact is for
    the force sensor to tell. Runs between `start` and `close`, or inside a `with` block. The stage
    stays connected and is not stopped.
    """

    def __init__(
        self,
        read_status: Callable[[], StageStatus],
        *,
        origin_m: tuple[float, float],
        direction: tuple[float, float] = (1.0, 0.0),
        interval_s: float = 0.005,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        if not abs(math.hypot(*direction) - 1.0) < 1e-3:
            raise ValueError(f"stage direction {direction} must be a unit vector")
        self._read_status = read_status
        self._origin_m, self._direction = origin_m, direction
        self._interval_s = interval_s
        self._clock = clock
        self._newest: StageStatus | None = None
        self._error: DeviceError | None = None
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._poll, name="stage position", daemon=True)

    def start(self) -> None:
        """Ask once, then go on asking in the background. Raises DeviceError."""
        self._newest = self._read_status()
        self._thread.start()

    def close(self) -> None:
        self._ended.set()
        if self._thread.is_alive():
            self._thread.join()

    def read(self) -> FingerReading:
        """Return the newest position. Raises what ended the polling, and DeviceTimeout when the
        newest is too old.
        """
        if self._error is not None:
            raise type(self._error)(self._error.message, self._error.hint) from self._error
        status = self._newest
        if status is None or self._clock() - status.time_s > STALE_AFTER_S:
            raise DeviceTimeout(
                f"the stage has reported no position for {STALE_AFTER_S:g} s", "start it; try again"
            )
        if not status.homed:
            return FingerReading(status.time_s, math.nan, math.nan, False)
        x_m, y_m = (
            o + d * status.position_m for o, d in zip(self._origin_m, self._direction, strict=True)
        )
        return FingerReading(status.time_s, x_m, y_m, True)

    def _poll(self) -> None:
        while not self._ended.wait(self._interval_s):
            try:
                self._newest = self._read_status()
            except DeviceError as error:
                self._error = error
                return


class RecordedFinger:
    """A slide played back in real time from the first reading on; arrays [n], times rising,
    positions in metres.

    Each reading is the newest recorded sample, with its time moved to `clock`. After the end the
    finger has lifted at the last place. Raises ValueError for arrays that are no recording.
    """

    def __init__(
        self,
        time_s: Array,
        position_x_m: Array,
        position_y_m: Array,
        touching: NDArray[np.bool_],
        *,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        shapes = {np.shape(column) for column in (time_s, position_x_m, position_y_m, touching)}
        if len(shapes) != 1 or np.ndim(time_s) != 1 or len(time_s) < 1:
            raise ValueError(f"a recording has four columns of one length, not {sorted(shapes)}")
        if not (np.all(np.isfinite(time_s)) and np.all(np.diff(time_s) > 0.0)):
            raise ValueError("the times of a recording must be numbers and rise")
        self._time_s = np.asarray(time_s) - time_s[0]
        self._columns = position_x_m, position_y_m, touching
        self._clock = clock
        self._began_s: float | None = None

    def read(self) -> FingerReading:
        """Return the sample that is due."""
        now_s = self._clock()
        self._began_s = now_s if self._began_s is None else self._began_s
        i = int(np.searchsorted(self._time_s, now_s - self._began_s, side="right")) - 1
        x_m, y_m, touching = (column[i] for column in self._columns)
        if now_s - self._began_s > self._time_s[-1]:
            return FingerReading(now_s, float(x_m), float(y_m), False)
        return FingerReading(
            self._began_s + float(self._time_s[i]), float(x_m), float(y_m), bool(touching)
        )
