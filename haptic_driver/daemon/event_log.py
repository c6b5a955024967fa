"""What happened, numbered without gaps, as far back as it is kept."""

from __future__ import annotations

import logging
import threading
import time
from collections import deque
from collections.abc import Callable
from typing import Any

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
        """Add one, now."""
        with self._lock:
            self._count += 1
            event = Event(number=self._count, time_s=time.monotonic(), kind=kind, message=message, data=data)
            self._events.append(event)
        self.listener(event)
        _log.log(logging.ERROR if kind in ("fault", "trip") else logging.INFO, "%s: %s", kind, message)

    def since(self, number: int) -> list[Event]:
        """Those above `number`."""
        with self._lock:
            return [event for event in self._events if event.number > number]
