"""Hears the edges of a line in, from a thread of its own."""

from __future__ import annotations

import time
from collections.abc import Callable
from math import inf
from typing import NamedTuple

from haptic_driver.processes.kept import KeptOpen
from hw.event_line.contract import LineIn

LOOK_S = 0.001


class EdgeIn(NamedTuple):
    """A rise: its number, from 1, and when it was seen; it came at most `within_s` before."""

    number: int
    time_s: float
    within_s: float


class _LookedAt:
    """A line that is open once its level is known: what rises from then on is an edge."""

    def __init__(self, line: LineIn) -> None:
        self.high = False
        self._line = line

    def open(self) -> None:
        self._line.open()
        levels = self._line.levels()
        self.high = bool(levels) and levels[-1]

    def close(self) -> None:
        self._line.close()


class LineInReader:
    """Calls `heard` for each edge, between `start` and `close`, and `told` when the line is lost or
    back. Neither may take long.

    A rise is an edge where the line may have been low for `low_s` before. Nobody knows when several
    levels in one look were. Other rises are bouncing, and counted. A line that is high when it is
    opened has no edge.
    """

    def __init__(
        self,
        line: LineIn,
        low_s: float,
        heard: Callable[[EdgeIn], object],
        told: Callable[[str], object],
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.line = line
        self.edges = self.bounces = 0
        self._low_s, self._clock = low_s, clock
        self._heard, self._told = heard, told
        self._looked = _LookedAt(line)
        self._kept = KeptOpen("line_in", self._looked, self._serve, self._tell)
        self.start, self.close = self._kept.start, self._kept.close

    @property
    def lost(self) -> str | None:
        """Why nothing is heard; None while something is."""
        return self._kept.lost

    def _tell(self, lost: str | None) -> None:
        back = f"{self.line.resource} is heard again"
        self._told(back if lost is None else f"no edges are heard: {lost}; it is tried again")

    def _serve(self) -> None:
        before = self._looked.high
        looked_s, high_s = self._clock(), -inf  # last looked; last seen high
        while not self._kept.ending.is_set():
            levels = self.line.levels()
            now_s = self._clock()
            for number, high in enumerate(levels, 1):
                if high and not before:
                    self._rose(now_s, now_s - looked_s, now_s - high_s)
                if high:
                    high_s = now_s if number == len(levels) else looked_s
                before = high
            looked_s = now_s
            self._kept.ending.wait(LOOK_S)

    def _rose(self, time_s: float, within_s: float, low_s: float) -> None:
        if low_s < self._low_s:
            self.bounces += 1
            return
        self.edges += 1
        self._heard(EdgeIn(self.edges, time_s, within_s))
