"""What this machine can do: fixed work beside which claims are measured, in the same run."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates

from haptic_driver.signals import Array

RECORDS = 20  # a tick makes so many: samples, states, points, commands and what holds them
TABLE_SHAPE = (85, 121, 15)  # of a gap table


class Record(NamedTuple):
    """Eight numbers, as a record of a tick has them."""

    a: float
    b: float
    c: float
    d: float
    e: float
    f: float
    g: float
    h: float


def _handed_on(r: Record) -> Record:
    return Record(r.a + 1.0, r.b, r.c, r.d, r.e, r.f, r.g, r.h)


def hand_on_records() -> Record:
    """Make as many records as a tick does, each by a function that reads the one before."""
    record = Record(0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0)
    for _ in range(RECORDS):
        record = _handed_on(record)
    return record


class LookUps:
    """Cubic look-ups, of 64 nodes each, in a table of the gap table's size: scipy's, one thread."""

    def __init__(self, count: int) -> None:
        rng = np.random.default_rng(1)
        self._table: NDArray[Any] = rng.uniform(0.0, 1.0, TABLE_SHAPE)
        sizes = np.array(TABLE_SHAPE, float)[:, None]
        self._places = rng.uniform(0.1, 0.9, (3, count)) * sizes

    def __call__(self) -> Array:
        """All of them once."""
        return np.asarray(map_coordinates(self._table, self._places, order=3, prefilter=False))
