"""What happened, numbered without gaps, as far back as it is kept."""

from __future__ import annotations

import logging
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from heapq import merge
from typing import Any

from haptic_driver.errors import shown
from haptic_driver.recording.event import Event

EVENTS_KEPT = 1000
# Kinds that may come many times a second: each kept apart, and logged for whoever looks.
OFTEN = ("scene", "edge_in")

_log = logging.getLogger("haptic_driver.daemon")


class EventLog:
    """Events for the API; each also goes to the log, and to `listeners`. Thread-safe."""

    def __init__(self) -> None:
        self.listeners: list[Callable[[Event], object]] = []
        self._seldom: deque[Event] = deque(maxlen=EVENTS_KEPT)
        self._often = {kind: deque[Event](maxlen=EVENTS_KEPT) for kind in OFTEN}
        self._count = 0
        self._lock = threading.Lock()

    def tell(self, kind: str, message: str, **data: Any) -> None:
        self.add(kind, message, data)

    def add(
        self, kind: str, message: str, data: Mapping[str, Any], time_s: float | None = None
    ) -> Event:
        """Add one that happened at `time_s` of CLOCK_MONOTONIC, by default now."""
        with self._lock:
            self._count += 1
            happened_s = time.monotonic() if time_s is None else time_s
            said = shown(message)  # somebody's words, or a texture's name
            event = Event(
                number=self._count, time_s=happened_s, kind=kind, message=said, data=dict(data)
            )
            self._often.get(kind, self._seldom).append(event)
        for listener in self.listeners:
            listener(event)
        usual = logging.DEBUG if kind in OFTEN else logging.INFO
        _log.log(logging.ERROR if kind in ("fault", "trip") else usual, "%s: %s", kind, said)
        return event

    def since(self, number: int) -> list[Event]:
        with self._lock:
            kept = merge(self._seldom, *self._often.values(), key=lambda event: event.number)
            return [event for event in kept if event.number > number]
