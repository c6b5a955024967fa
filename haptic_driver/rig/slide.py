"""What a finger does along x: made up, or recorded in a file."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from haptic_driver.errors import BadInputError
from haptic_driver.fidelity.strokes import moving_average
from haptic_driver.files import bad_input
from haptic_driver.signals import TICK_S, Array
from model.support.tables import Table, read_table

COLUMNS = ("time_s", "position_m", "normal_force_n")
LARGEST = {"position_m": 10.0, "normal_force_n": 50.0}  # beyond, the unit must be wrong


@dataclass(frozen=True)
class Slide:
    """What a finger does: arrays [n], evenly spaced by TICK_S; `position_m` along x."""

    name: str
    time_s: Array
    position_m: Array
    normal_force_n: Array

    @property
    def speed_m_s(self) -> Array:
        """Speed along x, over a window of 10 ms against the resolution of the encoder."""
        return np.asarray(np.gradient(moving_average(self.position_m, 10), TICK_S))


def synthetic_slide() -> Slide:
    """Two strokes of 80 mm, there and back, at up to 50 mm/s under about 0.5 N, with a lift in
    between.
    """
    time = np.arange(0.0, 6.4, TICK_S)
    there, back = _stroke(time, 0.6, 2.2), _stroke(time, 3.7, 2.2)
    press = (
        _stroke(time, 0.3, 0.15)
        - _stroke(time, 2.95, 0.15)
        + _stroke(time, 3.4, 0.15)
        - _stroke(time, 6.05, 0.15)
    )
    load = press * (0.50 + 0.06 * np.sin(2.0 * np.pi * 0.9 * time))
    return Slide("synthetic slide", time, 0.080 * (there - back), load)


def _stroke(time: Array, start_s: float, duration_s: float) -> Array:
    """0 to 1 with least jerk."""
    x = np.clip((time - start_s) / duration_s, 0.0, 1.0)
    return np.asarray(x**3 * (10.0 - 15.0 * x + 6.0 * x * x))


def read_slide(path: Path) -> Slide:
    """A recorded slide: CSV with `time_s, position_m, normal_force_n`, rising in time; resampled to
    the tick.
    """
    wanted = f"Give a CSV with columns {', '.join(COLUMNS)}, time rising, at least 10 rows"
    read = read_table(path, COLUMNS, wanted)
    table = np.column_stack([_numbers(read, column) for column in COLUMNS])
    if len(table) < 10:
        raise BadInputError("bad_slide", f"{path}: has {len(table)} rows", wanted)
    with bad_input("bad_slide"):
        read.require_rising("time_s", table[:, 0], f"Give one slide. {wanted}")
    if table[-1, 0] - table[0, 0] < 10 * TICK_S:
        raise BadInputError(
            "bad_slide", f"{path}: lasts less than {10 * TICK_S:g} s; is time_s in seconds?", wanted
        )
    if table[-1, 0] - table[0, 0] > 3600.0:
        raise BadInputError(
            "bad_slide", f"{path}: lasts longer than an hour; is time_s in seconds?", wanted
        )
    if table[:, 2].max() <= 0.0:
        raise BadInputError(
            "bad_slide",
            f"{path}: normal_force_n is never above 0: the finger never touches",
            "Give the force that presses on the screen, in N, as positive",
        )
    time = np.arange(table[0, 0], table[-1, 0], TICK_S)
    position, force = (np.interp(time, table[:, 0], table[:, i]) for i in (1, 2))
    return Slide(path.name, time, position, force)


def _numbers(table: Table, column: str) -> Array:
    values = table.numbers(column)
    too_large = np.flatnonzero(np.abs(values) > LARGEST.get(column, np.inf))
    if too_large.size:
        i = int(too_large[0])
        said = f"{table.where(i)}: {column} = {values[i]:g} is out of range"
        raise BadInputError("bad_slide", said, f"Give at most {LARGEST[column]:g} in SI units")
    return values
