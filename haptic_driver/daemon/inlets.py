"""Markers of other programs, from a stream of the Lab Streaming Layer (extra `lsl`), among the
daemon's events.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Any, Protocol

from haptic_driver.errors import optional, shown
from haptic_driver.processes.started import start_thread
from haptic_driver.recording.clock import lsl_offset_s

LOOK_S = 0.2  # between looks at whether to end
OPEN_S = 5.0
MOST_CHARACTERS = 200
NOTHING_SAID = "(nothing)"


class Heard(Protocol):
    """Takes a marker: `EventLog.add`."""

    def __call__(
        self, kind: str, message: str, data: dict[str, Any], time_s: float | None = None
    ) -> object:
        """Of kind `marker`, with the time on CLOCK_MONOTONIC at which its program has sent it; of
        kind `inlet`, what has become of the stream.
        """


class LslMarkers:
    """The first stream of that name on the local network, of one channel, found again when it was
    gone.
    """

    def __init__(self, stream: str) -> None:
        self._lsl = optional("pylsl", "lsl", "LSL")
        self._stream = stream
        self._inlet: Any = None
        self._correction_s = 0.0
        self._was_lost = False

    def hear(self, tell: Heard) -> None:
        """Pass on what has come, waiting at most about `LOOK_S` for it, and for the stream at
        first. A stream that is lost, or found again, is reported as `inlet`.
        """
        try:
            if self._inlet is None and not self._found(tell):
                return
            said, stamp_s = self._inlet.pull_sample(timeout=LOOK_S)
            if said is None:
                return
            with suppress(RuntimeError, TimeoutError):  # the clocks have hardly moved since
                self._correction_s = self._inlet.time_correction(timeout=OPEN_S)
        except (RuntimeError, TimeoutError) as error:  # LostError is a RuntimeError
            self._lose(tell, error)
            return
        time_s = stamp_s + self._correction_s - lsl_offset_s(self._lsl)
        tell("marker", label_of(str(said[0])), {"stream": self._stream}, time_s)

    def _found(self, tell: Heard) -> bool:
        """Whether the stream is there, and open.

        A library that waits for a lost stream by itself would wait for the same sender, without a
        message. A sender that was started again is another.
        """
        found = self._lsl.resolve_byprop("name", self._stream, timeout=LOOK_S)
        if not found:
            return False
        self._inlet = self._lsl.StreamInlet(found[0], recover=False)
        self._inlet.open_stream(timeout=OPEN_S)
        self._correction_s = self._inlet.time_correction(timeout=OPEN_S)
        if self._was_lost:
            self._was_lost = False
            tell("inlet", f"stream {self._stream!r} is heard again", {"stream": self._stream})
        return True

    def _lose(self, tell: Heard, error: Exception) -> None:
        self._inlet = None
        if not self._was_lost:
            self._was_lost = True
            why = str(error) or type(error).__name__
            said = (
                f"stream {self._stream!r} is lost ({why}); its markers are missing until it is back"
            )
            tell("inlet", said, {"stream": self._stream})


def label_of(text: str) -> str:
    """What another program said, as `haptic mark` would take it: 1 to 200 characters that print."""
    return shown(text)[:MOST_CHARACTERS] or NOTHING_SAID


@contextmanager
def hearing(inlet: LslMarkers, tell: Heard, failed: Callable[[str], object]) -> Iterator[None]:
    """Listen in a thread of its own inside the `with` block; the first error goes to `failed` and
    ends it.
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
