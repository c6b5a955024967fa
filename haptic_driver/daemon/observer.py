"""The observer: the process that holds what is felt against what is expected, and how control hears
of it.

    python -m haptic_driver.daemon.observer DESCRIPTOR LINK < settings

takes pickled `FollowSettings` and `JudgeSettings`. Every `period_s` it says what came of the ring's
new samples, and every second how well the newest were rendered.
"""

from __future__ import annotations

import pickle
import socket
import sys
import threading
import time
from collections import deque
from contextlib import suppress
from multiprocessing.connection import Connection

from haptic_driver.daemon.event_log import EventLog
from haptic_driver.daemon.judge import PERIOD_S, Judge, Judged, JudgeSettings
from haptic_driver.daemon.messages import AgreementCell
from haptic_driver.live.follow import Following, FollowSettings, Observed
from haptic_driver.live.swap import Install, Swap, Word
from haptic_driver.live.window import Window
from haptic_driver.lookup.models import load_model
from haptic_driver.processes import parent
from haptic_driver.processes.child import Child
from haptic_driver.processes.compilation import compilation_said
from haptic_driver.processes.kept import RETRY_S
from haptic_driver.processes.real_time import give_way
from haptic_driver.processes.shared_memory import SharedState
from haptic_driver.processes.started import start_thread
from haptic_driver.recording.clock import clock_offsets

NAME = "observer"
ROWS_KEPT = 1000  # for a diagnosis


class Observer:
    """The process for one model as control hears it, in a thread; started again when it dies.

    `rows` are the newest windows, oldest first; `said` the last disagreement. `adaptation` is the
    latest result of a refit.
    """

    def __init__(
        self,
        settings: tuple[FollowSettings, JudgeSettings],
        shared: SharedState,
        events: EventLog,
        install: Install,
        adaptation: str | None = None,
    ) -> None:
        self.cells: list[AgreementCell] = []
        self.said: str | None = None
        self.judged = Judged()
        self.rows: deque[Window] = deque(maxlen=ROWS_KEPT)
        self.swap = Swap(settings[0].surface, install, events.tell, self._send, adaptation)
        self._shared, self._events = shared, events
        # in this thread: what others look up on a surface meanwhile is kept in it
        self._given = pickle.dumps(settings)
        self._link: Connection | None = None
        self._child: Child | None = None
        self._listening: threading.Thread | None = None

    def start(self) -> None:
        self._listening = start_thread("observe", self._listen)

    def end(self) -> None:
        """Begin nothing any more."""
        self.swap.ending.set()
        if self._child is not None:
            self._child.kill()

    def close(self) -> None:
        self.end()
        if self._listening is not None:
            self._listening.join()

    @property
    def pids(self) -> dict[str, int]:
        """Its process id, while there is one."""
        child = self._child
        return {NAME: child.pid} if child is not None else {}

    def _send(self, word: Word) -> None:
        with suppress(OSError):
            if self._link is not None:
                self._link.send(word)

    def _listen(self) -> None:
        ending = self.swap.ending
        while not ending.is_set():
            how = self._attend()
            self.judged = Judged()
            if not ending.is_set():
                self._events.tell(NAME, f"{how}; it is started again, rendering goes on")
                while not (ending.wait(RETRY_S) or self.swap.back()):  # its refit is gone
                    pass

    def _attend(self) -> str:
        """Start one and hear it until it ends, or is to; how that was."""
        child = None
        with suppress(EOFError, OSError):  # it has died, or there was nothing to start it with
            ours, theirs = socket.socketpair()
            with Connection(ours.detach()) as link:
                with theirs:
                    passed = [self._shared.descriptor, theirs.fileno()]
                    child = Child(NAME, __name__, passed, given=self._given, descriptors=passed)
                self._child, self._link = child, link
                if self.swap.said is not None:
                    link.send(Word.ADAPT)
                while not self.swap.ending.is_set():
                    self.judged, observed = link.recv()
                    if observed is not None:
                        self._hear(observed)
        if child is None:
            return "the observer process was not started"
        child.kill()
        return child.ended or "the observer process does not end"

    def _hear(self, observed: Observed) -> None:
        self.rows.extend(observed.windows)
        if observed.proposal is not None:
            self.swap.take(observed.proposal)
        self.cells = [AgreementCell(**cell._asdict()) for cell in observed.cells]
        for found in observed.found:
            began = time.localtime(found.since_s + clock_offsets().wall_offset_s)
            self.said = f"{found}, since {time.strftime('%H:%M', began)}"
            self._events.tell("agreement", self.said, **found._asdict())


def main() -> None:
    """Observe until control hangs up."""
    give_way()
    shared = SharedState(int(sys.argv[1]))
    settings: FollowSettings
    settings, judged = parent.given()
    with compilation_said(NAME):
        following = Following(settings, load_model(settings.model))
    judge, looked_s = Judge(judged, shared), time.monotonic()
    position, arming = shared.ring.position, shared.order.read().arming
    with Connection(int(sys.argv[2])) as link, suppress(EOFError, OSError):
        while True:
            if link.poll(min(settings.period_s, PERIOD_S)):
                following.hear(link.recv())
            if (now := shared.order.read().arming) != arming:
                arming = now
                following.begin()
            observed, now_s = None, time.monotonic()
            if now_s - looked_s >= settings.period_s:
                looked_s = now_s
                samples, _, position = shared.ring.read(position)
                observed = following.add(samples)
            link.send((judge.look(), observed))


if __name__ == "__main__":
    main()
