"""Puts an edge on the event line for each event that has a code, from a thread of its own.

Markers wake it at once. Contact and output are looked at every `LOOK_S`, in the samples of render
and at the pump. Each edge is an event of kind `edge`. Its time is when the line has taken it, and
`late_s` is the delay after the instant that it stands for, with `late` beyond `LATE_S`. One that
would come `TOO_LATE_S` after its instant or later is left out, and counted. A line that fails is
reported and tried again, and costs nothing but its edges.
"""

from __future__ import annotations

import queue
import re
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from typing import NamedTuple

from haptic_driver.daemon.event_log import EventLog
from haptic_driver.processes.kept import KeptOpen
from haptic_driver.processes.shared_memory import Ring
from haptic_driver.recording.event import Event
from haptic_driver.rig.evidence import KnownOutput
from haptic_driver.rig.parts.event_lines import EventCodes
from hw.event_line.contract import HIGHEST_CODE, EventLine

LOOK_S = 0.001
LATE_S = 0.1
TOO_LATE_S = 1.0
KIND = "event_line"  # of reports on the line itself
# What an experiment says for its own sake.
WITHOUT_EDGE = {"answer", "told", "experiment", "session begins", "session goes on"}
WITHOUT_EDGE |= {"session ends"}
_INTERVAL = re.compile(r"interval (\d) (begins|ends)")


class Due(NamedTuple):
    """An edge that is to come: of what, since when, and what more is to be said of it."""

    what: str
    code: int
    since_s: float
    data: Mapping[str, object] = {}


class EventLineWriter:
    """Writes to `line` what `events` and the samples of `ring` hold from `start` to `close`.

    `output` says what is known of the output; `missed` is called for each edge that did not come.
    """

    def __init__(
        self,
        line: EventLine,
        pulse_s: float,
        codes: EventCodes,
        ring: Ring,
        output: Callable[[], KnownOutput],
        events: EventLog,
        missed: Callable[[], object],
    ) -> None:
        self.line = line
        self._pulse_s, self._codes = pulse_s, codes
        self._coded = Codes(codes)
        self._ring, self._output = ring, output
        self._events, self._missed = events, missed
        self._due: queue.SimpleQueue[Due] = queue.SimpleQueue()
        self._waiting: deque[Due] = deque()  # in the order in which they happened
        self._left_out = 0  # since the last edge
        self._position = 0  # in the ring
        self._touching, self._on = False, False
        self._missing = 0  # while the line is lost
        self._kept = KeptOpen("event_line", line, self._serve, self._tell, self._miss)
        self.close = self._kept.close

    def start(self) -> None:
        """Begin; what happens from here on has its edges."""
        self._position = self._ring.position
        self._events.listeners.append(self._hear)
        self._kept.start()

    def _hear(self, event: Event) -> None:
        if code := self._coded.of(event):
            self._due.put(Due(event.message, code, event.time_s, {"event": event.number}))

    def _tell(self, lost: str | None) -> None:
        if lost is not None:
            self._events.tell(KIND, f"no edges: {lost}; it is tried again")
            return
        said = f"{self.line.resource} is back; {self._missing} edges are missing"
        self._events.tell(KIND, said, missing=self._missing)
        self._missing = 0

    def _miss(self) -> None:
        """All that is due now comes to nothing."""
        for _ in (*self._waiting, *self._happened()):
            self._missed()
            self._missing += 1
        self._waiting.clear()

    def _serve(self) -> None:
        while not self._kept.ending.is_set():
            self._waiting += self._happened()
            while self._waiting:
                self._put(self._waiting.popleft())
            with suppress(queue.Empty):
                self._put(self._due.get(timeout=LOOK_S))

    def _put(self, due: Due) -> None:
        if time.monotonic() - due.since_s > TOO_LATE_S:
            self._left_out += 1
            self._missed()
            return
        try:
            self.line.put(due.code)
        except BaseException:
            self._waiting.appendleft(due)  # to be counted
            raise
        time_s = time.monotonic()
        late_s = time_s - due.since_s
        data = {"code": due.code, "late_s": late_s, **due.data}
        data |= {"late": True} if late_s > LATE_S else {}
        self._events.add("edge", due.what, data, time_s)
        if self._left_out:
            said = f"{self._left_out} edges would have come too late, and are missing"
            self._events.tell(KIND, said, missing=self._left_out)
            self._left_out = 0
        time.sleep(self._pulse_s)
        self.line.put(0)
        time.sleep(self._pulse_s)

    def _happened(self) -> list[Due]:
        """All that is due now, in the order in which it happened."""
        due = self._seen()
        while not self._due.empty():
            due.append(self._due.get())
        return sorted(due, key=lambda one: one.since_s)

    def _seen(self) -> list[Due]:
        """Edges of contact and output since the last look."""
        taken = self._ring.read(self._position)
        self._position = taken.position
        times_s, contact = (taken.samples[name].tolist() for name in ("time_s", "in_contact"))
        due = list(self._contact(zip(times_s, contact, strict=True)))
        output = self._output()
        if output.on is not None and output.on != self._on:
            self._on = output.on
            code = self._codes.output_on if output.on else self._codes.output_off
            what = "output on" if output.on else "output off"
            due.append(Due(what, code, time.monotonic(), {"evidence": str(output)}))
        return [one for one in due if one.code]

    def _contact(self, samples: Iterable[tuple[float, int]]) -> Iterator[Due]:
        for time_s, in_contact in samples:
            if bool(in_contact) != self._touching:
                self._touching = bool(in_contact)
                what = "touch" if in_contact else "lift"
                yield Due(what, getattr(self._codes, what), time_s)


class Codes:
    """Which code an event has, by the table of a rig's file.

    An answer's number is its place among those of the last question, as `answers.py` of
    psychophysics has them; a question counts once.
    """

    def __init__(self, codes: EventCodes) -> None:
        self._codes = codes
        self._answers: list[object] = []

    def of(self, event: Event) -> int:
        """The code of an event's edge, 0 where it has none."""
        if event.kind != "marker":
            return 0
        own = event.data.get("code")
        if isinstance(own, int) and 0 <= own <= HIGHEST_CODE:
            return own
        if event.message == "question":
            answers = event.data.get("answers")
            self._answers = answers if isinstance(answers, list) else []
            return 0
        answers = self._answers  # another thread may hear of another question meanwhile
        word = event.data.get("answer") if event.message == "answer" else event.message
        if word not in answers:
            return self._named(event.message, event.data)
        self._answers = []
        number = answers.index(word) + 1
        return _numbered(self._codes.answer, number) if len(answers) > 1 else 0

    def _named(self, label: str, data: Mapping[str, object]) -> int:
        codes = self._codes
        if found := _INTERVAL.fullmatch(label):
            first = codes.interval if found[2] == "begins" else codes.interval_end
            return _numbered(first, int(found[1]))
        named = {"trial begins": codes.trial, "trial ends": codes.trial_end}
        named["answered"] = _numbered(codes.answer, data.get("answer"))
        return (named | dict.fromkeys(WITHOUT_EDGE, 0)).get(label, codes.marker)


def _numbered(first: int, number: object) -> int:
    """The code of the first, second, ... of its kind."""
    return first + number if first and isinstance(number, int) and 1 <= number <= 9 else 0
