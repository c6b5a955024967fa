"""Makes recordings of the edges of a rig's line in: one edge begins a recording, the next ends it.

Edges are events of kind `edge_in`, in the recording that they begin or end. Nothing here arms the
rig, or asks for output.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path

from haptic_driver.daemon.event_log import EventLog
from haptic_driver.daemon.messages import LineInStatus
from haptic_driver.errors import message_of
from haptic_driver.processes.patience import join_within
from haptic_driver.processes.started import start_thread
from haptic_driver.rig.line_in import EdgeIn, LineInReader
from haptic_driver.rig.parts.lines_in import LineInSection
from hw.event_line.contract import LineIn

KIND = "line_in"  # of reports on the line itself
EDGE = "edge_in"
END_S = 10.0


class LineInWatch:
    """Reads `line` between `start` and `close`, and does with each edge as `section` says.

    A recording that somebody else has begun is left alone. Edges come to nothing while one is
    being begun or ended. Those are counted, as are all others that did nothing. `record` begins a
    recording, and ends it with None. `asked` says where to the present one was begun.
    """

    def __init__(
        self,
        line: LineIn,
        section: LineInSection,
        record: Callable[[Path | None], object],
        asked: Callable[[], Path | None],
        events: EventLog,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.line = line
        self._section, self._events = section, events
        self._record, self._asked = record, asked
        self._reader = LineInReader(line, section.low_s, self._heard, self._told, clock)
        self._acting: threading.Thread | None = None
        self._mine: Path | None = None  # the recording that an edge began
        self._ignored = 0
        self._failed = ""  # what the last order to record came to, where that was nothing
        self._last_s: float | None = None

    def start(self) -> None:
        self._reader.start()

    def close(self) -> None:
        """Let go of the line, once a recording that is being begun has been."""
        self._reader.close()
        if self._acting is not None:
            join_within(END_S, [self._acting])

    def status(self) -> LineInStatus:
        reader = self._reader
        return LineInStatus(
            start=self._section.start,
            edges=reader.edges,
            ignored=self._ignored,
            bounces=reader.bounces,
            last_edge_s=self._last_s,
            lost=reader.lost,
        )

    def _told(self, said: str) -> None:
        self._events.tell(KIND, said)

    def _heard(self, edge: EdgeIn) -> None:
        self._last_s = edge.time_s
        if self._section.start == "stroke":
            self._tell(edge, "for strokes, which haptic measure begins")
        elif self._acting is not None and self._acting.is_alive():
            self._ignore(edge, "a recording is just being begun or ended")
        else:
            self._acting = start_thread("begin", self._act, edge)

    def _act(self, edge: EdgeIn) -> None:
        present = self._asked()
        if present is None:
            self._begin(edge)
        elif present == self._mine:
            self._tell(edge, "ends the recording")
            self._order(None)
        else:
            self._ignore(edge, "a recording is running that no edge began")

    def _begin(self, edge: EdgeIn) -> None:
        self._mine = Path(self._section.folder).absolute() / _name()
        if self._order(self._mine):
            self._tell(edge, "begins a recording")
        else:
            self._ignore(edge, "no recording could be begun")

    def _order(self, path: Path | None) -> bool:
        """Whether that went well; an event says why not, once until that changes."""
        try:
            self._record(path)
        except Exception as error:  # whatever it is, the next edge is heard
            said = message_of(error)
            failed = said if path is None else said.replace(path.name, "a recording")
        else:
            failed = ""
        if failed and failed != self._failed:
            self._told(failed)
        self._failed = failed
        return not failed

    def _ignore(self, edge: EdgeIn, why: str) -> None:
        self._ignored += 1
        self._tell(edge, f"does nothing: {why}")

    def _tell(self, edge: EdgeIn, what: str) -> None:
        data = {"number": edge.number, "within_s": edge.within_s}
        self._events.add(EDGE, f"edge {edge.number}: {what}", data, edge.time_s)


def _name() -> str:
    """A file's name by the time of day, UTC, to the millisecond."""
    now = datetime.now(UTC)
    return f"edge-{now:%Y%m%dT%H%M%S}-{now.microsecond // 1000:03d}.h5"
