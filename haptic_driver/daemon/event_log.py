"""What happened, numbered without gaps, as far back as it is kept."""

from __future__ import annotations

import logging
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from typing import Any

from haptic_driver.errors import shown
from haptic_driver.recording.event import Event

EVENTS_KEPT = 1000

_log = logging.getLogger("haptic_driver.daemon")


class EventLog:
    """Events for the API; each also goes to the log, and to `listener`. Thread-safe."""

    def __init__(self) -> None:
        self.listener: Callable[[Event], object] = lambda event: None
        self._events: deque[Event] = deque(maxlen=EVENTS_KEPT)
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
            self._events.append(event)
        self.listener(event)
        _log.log(logging.ERROR if kind in ("fault", "trip") else logging.INFO, "%s: %s", kind, said)
        return event

    def since(self, number: int) -> list[Event]:
        with self._lock:
            return [event for event in self._events if event.number > number]
