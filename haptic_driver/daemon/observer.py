"""The observer: the process that holds what is felt against what is expected, and how control hears
of it.

    python -m haptic_driver.daemon.observer DESCRIPTOR LINK < settings

takes pickled `ObserverSettings`. Every `period_s` of them it says what came of the ring's new
samples, and every second how well the newest were rendered.
"""

from __future__ import annotations

import pickle
import socket
import sys
import threading
import time
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from math import inf
from multiprocessing.connection import Connection
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from haptic_driver.daemon.event_log import EventLog
from haptic_driver.daemon.judge import PERIOD_S, Judge, Judged
from haptic_driver.daemon.messages import AgreementCell
from haptic_driver.daemon.observation import Observation, Observed, ObserverSettings, Proposal, Word
from haptic_driver.experiments.recorded import Recorded
from haptic_driver.processes import parent
from haptic_driver.processes.child import Child
from haptic_driver.processes.compilation import compilation_said
from haptic_driver.processes.real_time import give_way
from haptic_driver.processes.shared_memory import SharedState
from haptic_driver.recording.clock import clock_offsets
from haptic_driver.surface.file import SurfaceFile
from haptic_driver.surface.models import load_model

if TYPE_CHECKING:
    from haptic_driver.daemon.adaptation import Adaptation

NAME = "observer"
ROWS_KEPT = 1000  # for a diagnosis
RETRY_S = 1.0
TOLD_S = 60.0  # between events of what was not mended
NOTHING_YET = "nothing is mended yet"

Install = Callable[[SurfaceFile, Callable[[], bool]], bool]


class Observer:
    """The process as control hears it, in a thread; started again when it dies. Rows are the
    newest, oldest first.

    `install` lets render go on with another surface, unless what it is told to ask says that it is
    too late.
    """

    def __init__(self, shared: SharedState, events: EventLog, install: Install) -> None:
        self.cells: list[AgreementCell] = []
        self.said: str | None = None
        self.adaptation: str | None = (
            None  # what came of mending last; None while nothing is mended
        )
        self.judged = Judged()
        self.rows: deque[Recorded] = deque(maxlen=ROWS_KEPT)
        self._shared, self._events, self._install = shared, events, install
        self._link: Connection | None = None
        self._base: SurfaceFile | None = (
            None  # the model's own surface, while render goes by a mended one
        )
        self._child: Child | None = None
        self._told_s = -inf
        self._swapping = threading.RLock()
        self._ending = threading.Event()
        self._listening: threading.Thread | None = None

    def start(self, settings: ObserverSettings) -> None:
        """Begin, or begin anew with another model."""
        self._end()
        self.cells, self.said, self._base = [], None, None
        self.judged = Judged()
        self.rows.clear()
        self._ending = threading.Event()
        # in this thread: what others look up on a surface meanwhile is kept in it
        given = pickle.dumps(settings)
        self._listening = threading.Thread(
            target=self._listen,
            args=(given, settings.surface, self._ending),
            name="observe",
            daemon=True,
        )
        self._listening.start()

    def adapt(self, on: bool) -> None:
        """Mend the model from now on, or go back to it as it was, which is an event once render
        does.
        """
        with self._swapping:
            self.adaptation = (self.adaptation or NOTHING_YET) if on else None
            self._send(Word.ADAPT if on else Word.REST)
            if not on:
                self._go_back(self._ending)

    def _send(self, word: Word) -> None:
        with suppress(OSError):
            if self._link is not None:
                self._link.send(word)

    def close(self) -> None:
        self._end()
        if self._listening is not None:
            self._listening.join()

    def _end(self) -> None:
        self._ending.set()
        if self._child is not None:
            self._child.kill()

    @property
    def pids(self) -> dict[str, int]:
        """Its process id, while there is one."""
        child = self._child
        return {NAME: child.pid} if child is not None else {}

    def _listen(self, given: bytes, base: SurfaceFile, ending: threading.Event) -> None:
        while not ending.is_set():
            how = self._attend(given, base, ending)
            self.judged = Judged()
            if not ending.is_set():
                self._events.tell(NAME, f"{how}; it is started again, rendering goes on")
                while not (
                    ending.wait(RETRY_S) or self._go_back(ending)
                ):  # what it had mended is gone with it
                    pass

    def _attend(self, given: bytes, base: SurfaceFile, ending: threading.Event) -> str:
        """Start one and hear it until it ends, or is to; how that was."""
        child = None
        with suppress(EOFError, OSError):  # it has died, or there was nothing to start it with
            ours, theirs = socket.socketpair()
            with Connection(ours.detach()) as link:
                with theirs:
                    passed = [self._shared.descriptor, theirs.fileno()]
                    child = Child(NAME, __name__, passed, given=given, descriptors=passed)
                if not ending.is_set():  # else there may be another already
                    self._child, self._link = child, link
                if self.adaptation is not None:
                    link.send(Word.ADAPT)
                while not ending.is_set():
                    said = link.recv()
                    if isinstance(said, Judged):
                        self.judged = said
                    else:
                        self.hear(said, base, ending)
        if child is None:
            return "the observer process was not started"
        child.kill()
        return child.ended or "the observer process does not end"

    def _go_back(self, ending: threading.Event) -> bool:
        """Whether render goes by the model's own surface now."""
        with self._swapping:
            if self._base is None:
                return True
            if not self._install(self._base, ending.is_set):
                return False
            self._events.tell(
                "adapt", "back to the model as it was", surface_hash=self._base.content_hash
            )
            self._base = None
            self._send(Word.BASE)
            return True

    def _propose(self, proposal: Proposal, base: SurfaceFile, ending: threading.Event) -> None:
        if self.adaptation is None:  # switched off meanwhile
            return
        news, self.adaptation = proposal.said != self.adaptation, proposal.said
        if proposal.surface is None:
            if news and time.monotonic() - self._told_s > TOLD_S:
                self._told_s = time.monotonic()
                self._events.tell("adapt", f"not mended: {proposal.said}")
        elif self._install(proposal.surface, ending.is_set):
            self._base = base
            self._send(Word.TAKEN)
            self._events.tell(
                "adapt",
                f"mended: {proposal.said}",
                surface_hash=proposal.surface.content_hash,
                model=proposal.numbers,
                rows=proposal.rows,
            )

    def hear(self, observed: Observed, base: SurfaceFile, ending: threading.Event) -> None:
        """Take in what the process says, unless it is to end; `base` is the surface of the model as
        it was.
        """
        self.rows.extend(observed.rows)
        if observed.proposal is not None:
            with self._swapping:
                self._propose(observed.proposal, base, ending)
        self.cells = [AgreementCell.model_validate(cell) for cell in observed.cells]
        for found in observed.found:
            began = time.localtime(found.since_s + clock_offsets().wall_offset_s)
            self.said = f"{found}, since {time.strftime('%H:%M', began)}"
            self._events.tell("agreement", self.said, **found._asdict())


class Following:
    """What the process does with samples and words; the surface that it goes by is the one that
    render goes by.
    """

    def __init__(self, settings: ObserverSettings, adaptation: Adaptation) -> None:
        self._settings, self._adaptation = settings, adaptation
        self._observation = Observation(settings)
        self._adapts, self._offered = False, settings.surface

    def begin(self) -> None:
        self._observation.begin()

    def hear(self, word: Word) -> None:
        if word is Word.TAKEN:
            self._adaptation.taken()
            self._observation.expect(self._offered)
        elif word is Word.BASE:
            self._adaptation.begin()
            self._observation.expect(self._settings.surface)
        else:
            self._adapts = word is Word.ADAPT

    def add(self, samples: NDArray[np.void]) -> Observed:
        """What some more samples of SAMPLE [n] tell, and lead to."""
        observed = self._observation.add(samples)
        proposal = self._adaptation.add(observed.rows) if self._adapts else None
        if proposal is not None and proposal.surface is not None:
            self._offered = proposal.surface
        return observed._replace(proposal=proposal)


def main() -> None:
    """Observe until control hangs up."""
    give_way()
    from haptic_driver.daemon.adaptation import (  # noqa: PLC0415 - slow to import, and control does without
        Adaptation,
    )

    shared = SharedState(int(sys.argv[1]))
    settings: ObserverSettings = parent.given()
    with compilation_said(NAME):
        following = Following(settings, Adaptation(load_model(settings.model), settings.limits))
    judge, looked_s = Judge(settings.judge, shared), time.monotonic()
    position, arming = shared.ring.position, shared.order.read().arming
    with Connection(int(sys.argv[2])) as link, suppress(EOFError, OSError):
        while True:
            if link.poll(min(settings.period_s, PERIOD_S)):
                following.hear(link.recv())
            if (now := shared.order.read().arming) != arming:
                arming = now
                following.begin()
            link.send(judge.look())
            if (now_s := time.monotonic()) - looked_s >= settings.period_s:
                looked_s = now_s
                samples, _, position = shared.ring.read(position)
                link.send(following.add(samples))


if __name__ == "__main__":
    main()
