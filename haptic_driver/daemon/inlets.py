"""Markers of other programs, from a stream of the Lab Streaming Layer (extra `lsl`), among the
daemon's events.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, Protocol

from haptic_driver.errors import optional
from haptic_driver.processes.started import start_thread
from haptic_driver.recording.clock import lsl_offset_s

LOOK_S = 0.2  # between looks at whether to end
OPEN_S = 5.0
MOST_CHARACTERS = 200


class Heard(Protocol):
    """Takes a marker: `EventLog.add`."""

    def __call__(
        self, kind: str, message: str, data: dict[str, Any], time_s: float | None = None
    ) -> object:
        """Of kind `marker`, with the time on CLOCK_MONOTONIC at which its program has sent it."""


class LslMarkers:
    """The first stream of that name on the local network, of one channel, found again when it was
    gone.
    """

    def __init__(self, stream: str) -> None:
        self._lsl = optional("pylsl", "lsl", "LSL")
        self._stream = stream
        self._inlet: Any = None

    def hear(self, tell: Heard) -> None:
        """Pass on what has come, waiting at most about `LOOK_S` for it, and for the stream at
        first.
        """
        if self._inlet is None:
            found = self._lsl.resolve_byprop("name", self._stream, timeout=LOOK_S)
            if not found:
                return
            self._inlet = self._lsl.StreamInlet(found[0])
            self._inlet.open_stream(timeout=OPEN_S)
        said, stamp_s = self._inlet.pull_sample(timeout=LOOK_S)
        if said is not None:
            time_s = stamp_s + self._inlet.time_correction(timeout=OPEN_S) - lsl_offset_s(self._lsl)
            tell("marker", str(said[0])[:MOST_CHARACTERS], {"stream": self._stream}, time_s)


@contextmanager
def hearing(inlet: LslMarkers, tell: Heard, failed: Callable[[str], object]) -> Iterator[None]:
    """Listen in a thread of its own inside the `with` block; the first error is told to `failed`
    and ends it.
    """
    ending = threading.Event()

    def listen() -> None:
        while not ending.is_set():
            try:
                inlet.hear(tell)
            except (OSError, RuntimeError, ValueError, TimeoutError) as error:
                failed(f"{type(inlet).__name__} ended: {error}")
                return

    thread = start_thread("inlet", listen)
    try:
        yield
    finally:
        ending.set()
        thread.join()
