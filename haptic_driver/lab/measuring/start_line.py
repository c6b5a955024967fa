"""Has each row that slides wait for an edge of the rig's line in."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from haptic_driver.errors import HapticError
from haptic_driver.rig.config import RigConfig
from haptic_driver.rig.line_in import EdgeIn, LineInReader
from haptic_driver.rig.part import Wiring
from haptic_driver.rig.parts.lines_in import LineInSection
from hw.event_line.contract import LineIn

LONGEST_S = 600.0
LOOK_S = 0.002  # between looks at the edge while the load is held

Hold = Callable[[float], object]
"""Lets so much time pass on the bench, the load held."""


class StartLine:
    """Waits for edges; `ignored` counts those that came while nothing waited.

    `tell` hears what is waited for, and what comes to nothing.
    """

    def __init__(self, line: LineIn, low_s: float, tell: Callable[[str], None]) -> None:
        self.ignored = 0
        self._line, self._tell = line, tell
        self._used = 0  # edges that began a stroke, or nothing
        self._came = threading.Event()
        self.reader = LineInReader(line, low_s, self._heard, tell)

    def _heard(self, edge: EdgeIn) -> None:
        self._came.set()

    def wait(self, what: str, hold: Hold = lambda duration_s: None) -> None:
        """Until the next edge from now on. HapticError where none comes for `LONGEST_S`."""
        self._came.clear()
        missed = self.reader.edges - self._used
        if missed:
            self.ignored += missed
            self._tell(f"{what}: edges that came meanwhile and began nothing: {missed}")
        self._used += missed
        self._tell(f"{what}: waiting for an edge on {self._line.resource}")
        until_s = time.monotonic() + LONGEST_S
        while self.reader.edges == self._used:
            if time.monotonic() > until_s:
                said = f"{what}: no edge on {self._line.resource} for {LONGEST_S:g} s"
                why = self.reader.lost or "it is heard, and low"
                raise HapticError("no_edge", said, f"Look at the line ({why}); then --resume")
            self._came.wait(LOOK_S)
            hold(LOOK_S)
        self._used += 1


@contextmanager
def start_line(config: RigConfig, tell: Callable[[str], None]) -> Iterator[StartLine | None]:
    """What a rig's strokes wait for inside the `with` block; None where for nothing."""
    section = config.line_in
    if not isinstance(section, LineInSection) or section.start != "stroke":
        yield None
        return
    line = StartLine(section.make(Wiring()).device, section.low_s, tell)
    line.reader.start()
    try:
        yield line
    finally:
        line.reader.close()
