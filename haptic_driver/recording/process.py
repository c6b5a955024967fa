"""The recorder process: shared ring -> file; and the handle by which control starts, feeds and ends
it.

    python -m haptic_driver.recording.process RING TALK < settings

takes pickled `RecorderSettings` from standard input and says on standard output whether it records,
as one JSON line. Events come as datagrams over TALK; its end, also by the death of control, is the
end of the run. What is said there are JSON objects: `{"missing": null, "news": []}` when one of the
two changes, and last `{"why": null}` or what went wrong.
"""

from __future__ import annotations

import faulthandler
import json
import pickle
import signal
import socket
import sys
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from haptic_driver.errors import BadInputError, HapticError
from haptic_driver.processes import parent
from haptic_driver.processes.child import Child
from haptic_driver.processes.shared_memory import Ring, SharedState, Taken
from haptic_driver.processes.started import start_thread
from haptic_driver.recording.event import Event
from haptic_driver.recording.records import records_of
from haptic_driver.recording.writer import INTERVAL_S, RunHeader, RunWriter, left_in, record, where

START_TIMEOUT_S = 60.0  # on a busy machine
STOP_TIMEOUT_S = 10.0
SLOWEST_BYTES_S = 4e6  # at which HDF5 is made of a run meanwhile
MOST_BYTES = 1 << 17  # of one datagram
AHEAD_S = 4.0  # between two looks at the ring, which holds 16 s
MOST_HELD = 1 << 20  # ticks, 17 minutes and 260 MB: what a disk may stand still for


@dataclass(frozen=True)
class RecorderSettings:
    """Where to record, what to say of the run, and from which sample on."""

    path: Path
    header: RunHeader
    position: int


class Recorder:
    """A recorder process as control sees it. Raises BadInputError when `path` cannot be used.

    Nothing here waits for the disk, except `stop`.
    """

    def __init__(self, path: Path, header: RunHeader, shared: SharedState) -> None:
        self.path = where(path)  # what is there the process looks at: it may be anything
        self.missing: str | None = None  # what its run lacks so far, in words
        self._news: list[str] = []
        self._last: dict[str, Any] | None = None
        self._talk, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        try:
            settings = RecorderSettings(self.path, header, shared.ring.position)
            self._child = Child(
                "recorder",
                __name__,
                [shared.descriptor, theirs.fileno()],
                given=pickle.dumps(settings),
                descriptors=[shared.descriptor, theirs.fileno()],
            )
            said = self._child.ready(START_TIMEOUT_S)
            if "error" in said:
                self._child.stop()
                raise BadInputError(**said["error"])
        except BaseException:
            self._talk.close()
            raise
        finally:
            theirs.close()
        self._talk.setblocking(False)

    @property
    def pid(self) -> int:
        return self._child.pid

    def note(self, event: Event) -> None:
        """Record an event too. One that a stuck recorder does not take is left out; the numbers
        then show the gap.
        """
        with suppress(OSError):
            self._talk.send(event.model_dump_json().encode())

    def news(self) -> list[str]:
        """What has happened to its files since the last time, in words; `missing` is up to date
        afterwards.
        """
        self._hear()
        said, self._news = self._news, []
        return said

    def ended(self) -> str | None:
        """Why it has ended by itself (disk full, killed); None while it records."""
        return self._last_word() if self._child.ended else None

    def stop(self) -> str | None:
        """End the run in good order; why that failed, or None."""
        with suppress(OSError):
            self._talk.shutdown(socket.SHUT_WR)
        files = (each for each in (self.path, records_of(self.path)) if each.exists())
        size = sum(each.stat().st_size for each in files)
        self._talk.settimeout(STOP_TIMEOUT_S + size / SLOWEST_BYTES_S)
        return self._last_word()

    def _last_word(self) -> str | None:
        """What it said at its end; then nothing of it is left."""
        self._hear()
        self._talk.close()
        self._child.stop()
        if self._last is None:
            return f"{self._child.ended}; {left_in(self.path)}"
        why: str | None = self._last["why"]
        return why

    def _hear(self) -> None:
        """All that it has said, as long as the socket's timeout lets us wait."""
        with suppress(OSError):
            while self._last is None:
                try:
                    said = self._talk.recv(MOST_BYTES)
                except (
                    ConnectionResetError
                ):  # it left an event unread; what it said itself comes after that
                    said = self._talk.recv(MOST_BYTES)
                if not said:
                    return
                message = json.loads(said)
                if "why" in message:
                    self._last = message
                else:
                    self.missing, self._news = message["missing"], [*self._news, *message["news"]]


class Ahead:
    """Ticks taken out of the ring in time, whatever the disk keeps the recorder waiting for.

    A thread of its own takes them, for as long as this process lives. Beyond `MOST_HELD` they stay
    in the ring, which counts those that it loses.
    """

    def __init__(
        self, ring: Ring, position: int, sleep: Callable[[float], object] = time.sleep
    ) -> None:
        self._ring = ring
        self._position = position
        self._held: list[Taken] = []
        self._lock = threading.Lock()
        self._sleep = sleep
        start_thread("ahead", self._run)

    def drain(self) -> Sequence[Taken]:
        """What has come since the last time."""
        with self._lock:
            self._take()
            held, self._held = self._held, []
        return held

    def _run(self) -> None:
        while True:
            self._sleep(AHEAD_S)
            with self._lock:
                if sum(len(taken.samples) for taken in self._held) < MOST_HELD:
                    self._take()

    def _take(self) -> None:
        taken = self._ring.read(self._position)
        self._position = taken.position
        self._held.append(taken)


class _Talk:
    """The recorder's end of the conversation."""

    def __init__(self, descriptor: int) -> None:
        self._socket = socket.socket(fileno=descriptor)
        self._told: str | None = None
        signal.signal(signal.SIGTERM, lambda number, frame: self._hang_up())

    def wait(self) -> tuple[Sequence[Event], bool]:
        """Events until `INTERVAL_S` have passed or control hangs up, and whether it has."""
        events: list[Event] = []
        until_s = time.monotonic() + INTERVAL_S
        while (left_s := until_s - time.monotonic()) > 0.0:
            self._socket.settimeout(left_s)
            with suppress(TimeoutError):
                said = self._socket.recv(MOST_BYTES)
                if not said:
                    return events, True
                events.append(Event.model_validate_json(said))
        return events, False

    def tell(self, missing: str | None, news: Sequence[str]) -> None:
        """Say what is missing so far, where that has changed, and what is new; a slow control is
        not awaited.
        """
        if missing != self._told or news:
            with suppress(OSError):
                said = json.dumps({"missing": missing, "news": list(news)}).encode()
                self._socket.send(said, socket.MSG_DONTWAIT)
                self._told = missing

    def say_last(self, why: str | None) -> None:
        """Tell control how it ended, and hang up."""
        with suppress(OSError):
            self._socket.send(json.dumps({"why": why}).encode())
        self._socket.close()

    def _hang_up(self) -> None:
        with suppress(OSError):
            self._socket.shutdown(socket.SHUT_RD)


def main() -> int:
    """Record until control hangs up; exit status 1 when that failed."""
    faulthandler.enable()
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)  # too large a file is an error like a full disk
    shared, talk = SharedState(int(sys.argv[1])), _Talk(int(sys.argv[2]))
    settings: RecorderSettings = parent.given()
    ahead = Ahead(shared.ring, settings.position)
    try:
        writer = RunWriter(settings.path, settings.header)
    except HapticError as error:
        parent.tell({"error": error.content})
        return 1
    parent.tell({"recording": str(settings.path)})
    try:
        missing = record(writer, ahead.drain, talk.wait, talk.tell)
    except HapticError as error:
        talk.say_last(f"{error.message}. {error.hint}")
        return 1
    talk.say_last(missing)
    return 0


if __name__ == "__main__":
    sys.exit(main())
