"""Hears the edges of a line in, from a thread of its own, and keeps on trying where it is lost."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from contextlib import suppress
from math import inf
from typing import NamedTuple

from haptic_driver.errors import message_of
from haptic_driver.processes.patience import join_within
from haptic_driver.processes.started import start_thread
from hw.event_line.contract import LineIn

LOOK_S = 0.001
RETRY_S = 1.0
END_S = 2.0


class EdgeIn(NamedTuple):
    """A rise: its number, from 1, and when it was seen; it came at most `within_s` before."""

    number: int
    time_s: float
    within_s: float


class LineInReader:
    """Calls `heard` for each edge, between `start` and `close`, and `told` when the line is lost or
    back. Neither may take long.

    A rise is an edge where the line may have been low for `low_s` before. Nobody knows when several
    levels in one look were. Other rises are bouncing, and counted. A line that is high when it is
    opened has no edge. `lost` says why nothing is heard; None while something is.
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
        self.lost: str | None = "not open yet"
        self._low_s, self._clock = low_s, clock
        self._heard, self._told = heard, told
        self._ending = threading.Event()
        self._thread: threading.Thread | None = None

    def start(self) -> None:
        self._thread = start_thread("line_in", self._run)

    def close(self) -> None:
        """Let go of the line."""
        self._ending.set()
        if self._thread is not None:
            join_within(END_S, [self._thread])

    def _run(self) -> None:
        failure = ""
        while not self._ending.is_set():
            try:
                self.line.open()
                if failure:
                    self._told(f"{self.line.resource} is heard again")
                failure, self.lost = "", None
                self._serve()
            except BaseException as error:  # whatever a driver raises, all else goes on
                self._close()
                self.lost = message_of(error)
                if self.lost != failure:  # one thing once
                    failure = self.lost
                    self._told(f"no edges are heard: {failure}; it is tried again")
                self._ending.wait(RETRY_S)
        self._close()

    def _close(self) -> None:
        with suppress(BaseException):  # of a line that is gone, whatever a driver raises
            self.line.close()

    def _serve(self) -> None:
        first = self.line.levels()
        before = bool(first) and first[-1]
        looked_s, high_s = self._clock(), -inf  # last looked; last seen high
        while not self._ending.is_set():
            levels = self.line.levels()
            now_s = self._clock()
            for number, high in enumerate(levels, 1):
                if high and not before:
                    self._rose(now_s, now_s - looked_s, now_s - high_s)
                if high:
                    high_s = now_s if number == len(levels) else looked_s
                before = high
            looked_s = now_s
            self._ending.wait(LOOK_S)

    def _rose(self, time_s: float, within_s: float, low_s: float) -> None:
        if low_s < self._low_s:
            self.bounces += 1
            return
        self.edges += 1
        self._heard(EdgeIn(self.edges, time_s, within_s))
