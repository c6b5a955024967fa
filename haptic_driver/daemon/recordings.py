"""Begin and end recorded runs, and report those that end by themselves."""

from __future__ import annotations

import os
import shutil
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from importlib.metadata import version
from itertools import count
from pathlib import Path

from haptic_driver.daemon.event_log import EventLog
from haptic_driver.daemon.messages import InstrumentStatus, RefusedError
from haptic_driver.daemon.set_up import DaemonSettings
from haptic_driver.errors import BadInputError, HapticError
from haptic_driver.files import LONGEST_NAME_BYTES
from haptic_driver.processes.shared_memory import SharedState
from haptic_driver.processes.started import start_thread
from haptic_driver.recording.event import Event
from haptic_driver.recording.process import Recorder
from haptic_driver.recording.writer import RunHeader
from haptic_driver.rig.actuator import actuator_name

SPACE_BYTES = 48 << 20  # free before a recording goes on: two minutes of it, twice
LOOK_S = 2.0  # between looks at that
AFTER_LEASE_S = 2.0  # what a fault does afterwards is recorded too


class Recordings:
    """At most one recording at a time, into which events go too. `lock` is of whoever starts or
    stops one.

    A recording that ends by itself goes on in another file as soon as there is space. `fault` then
    says why it had to, or which ticks are missing, until it is stopped, which fails with the same.
    One that was begun with a lease ends `AFTER_LEASE_S` after it: nobody else would end it when its
    owner is killed. `holds` is whether a token is that of the present lease; `settings` and
    `instruments` are those of the moment; `calibration_ids` by device.
    """

    def __init__(
        self,
        shared: SharedState,
        events: EventLog,
        settings: Callable[[], DaemonSettings],
        calibration_ids: dict[str, str],
        holds: Callable[[str], bool],
        instruments: Callable[[], list[InstrumentStatus]],
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.lock = threading.Lock()
        self._fault: str | None = None  # of recorders that have ended
        self._shared = shared
        self._events = events
        self._settings = settings
        self._calibration_ids = calibration_ids
        self._holds = holds
        self._instruments = instruments
        self._clock = clock
        self._lease: str | None = None  # with which the present one ends
        self._held_s = 0.0  # when it was last there
        self._asked: Path | None = None
        self._recorder: Recorder | None = None
        self._stopped = threading.Event()  # of the present recording
        events.listeners.append(self._note)

    @property
    def path(self) -> Path | None:
        """Where to; None while nothing is recorded."""
        recorder = self._recorder
        return recorder.path if recorder is not None else None

    @property
    def asked(self) -> Path | None:
        """Where to the present one was begun, which may go on elsewhere; None without one."""
        return self._asked

    @property
    def pids(self) -> dict[str, int]:
        """The recorder's process id, if there is one."""
        recorder = self._recorder
        return {"recorder": recorder.pid} if recorder is not None else {}

    @property
    def fault(self) -> str | None:
        """What is missing of the present recording, in words."""
        recorder = self._recorder
        return _joined(self._fault, None if recorder is None else recorder.missing)

    def start(self, path: Path, lease: str | None = None) -> None:
        """Begin one, which may end with a lease. RefusedError while there is one, and where that is
        not the lease.

        BadInputError for a path that cannot be used.
        """
        if len(os.fsencode(path.name)) > LONGEST_NAME_BYTES:
            raise BadInputError(
                "name_too_long",
                f"{path.name[:20]}...: is longer than {LONGEST_NAME_BYTES} bytes",
                "Give a shorter name",
            )
        with self.lock:
            if lease is not None and not self._holds(lease):
                raise RefusedError(
                    "not_yours", "the recording is to end with a lease that is over", "arm again"
                )
            if self._asked is not None:
                raise RefusedError(
                    "recording",
                    f"already recording into {self.path or self._asked}",
                    "stop that first",
                )
            self._begin(path)
            self._asked, self._stopped = path, threading.Event()
            self._lease, self._held_s = lease, self._clock()

    def stop(self, lease: str | None = None) -> None:
        """End it, if there is one, and if it is to end with `lease`, where that is given.

        HapticError `recording_failed` where something of it is missing.
        """
        with self.lock:
            if lease is not None and lease != self._lease:
                return
            self._stopped.set()
            if self._recorder is not None:
                self._tell_instruments("as it ends")
            recorder, self._recorder = self._recorder, None
            fault, self._fault, self._asked, self._lease = self._fault, None, None, None
            restarted = fault is not None
            if recorder is not None:
                why = recorder.stop()
                self._events.tell(
                    "recording",
                    f"ended: {recorder.path}" if why is None else f"ended, not whole: {why}",
                )
                fault = _joined(fault, why)
        if fault is not None:
            went_on = f"; then into {recorder.path}" if recorder is not None and restarted else ""
            raise HapticError(
                "recording_failed",
                f"the recording is not whole: {fault}{went_on}",
                "look at the events",
            )

    def watch(self) -> None:
        """A run that ends by itself is reported, and goes on when it can; rendering goes on without
        it.
        """
        if self._asked is not None and self.lock.acquire(blocking=False):
            try:
                if self._recorder is not None:
                    self._watch(self._recorder)
                self._watch_lease()
            finally:
                self.lock.release()

    def _watch(self, recorder: Recorder) -> None:
        before = recorder.missing
        for said in recorder.news():
            self._events.tell("recording", said)
        if recorder.missing is not None and recorder.missing != before:
            self._events.tell("recording", recorder.missing)
        if (why := recorder.ended()) is not None:
            self._recorder = None
            self._fault = _joined(self._fault, recorder.missing, why)
            self._events.tell("recording", why)
            start_thread("record", self._go_on, self._stopped)

    def _watch_lease(self) -> None:
        if self._lease is None or self._holds(self._lease):
            self._held_s = self._clock()
        elif self._clock() - self._held_s > AFTER_LEASE_S and not self._stopped.is_set():
            self._stopped.set()
            self._events.tell("recording", "ends, since the lease with which it was begun is over")
            start_thread("record", self._end_left, self._lease)

    def _end_left(self, lease: str) -> None:
        with suppress(HapticError):  # an event says it
            self.stop(lease)

    def _go_on(self, stopped: threading.Event) -> None:
        while not stopped.wait(LOOK_S):
            with self.lock, suppress(OSError, HapticError):
                if stopped.is_set() or self._asked is None:
                    return
                if shutil.disk_usage(self._asked.parent).free >= SPACE_BYTES:
                    self._begin(_next(self._asked))
                    return

    def _begin(self, path: Path) -> None:
        recorder = Recorder(path, self._header(), self._shared)
        self._recorder = recorder
        self._events.tell("recording", f"into {recorder.path}")
        self._tell_instruments("as it begins")

    def _tell_instruments(self, when: str) -> None:
        """How well each instrument answers, among the recording's events."""
        told = [one.model_dump(mode="json") for one in self._instruments()]
        wrong = [f"{one['name']}: {one['wrong']}" for one in told if one["wrong"]]
        said = "; ".join(wrong) or "nothing speaks against their readings"
        self._events.tell("instruments", f"{when}: {said}", instruments=told)

    def _note(self, event: Event) -> None:
        if self._recorder is not None:
            self._recorder.note(event)

    def _header(self) -> RunHeader:
        settings = self._settings()
        return RunHeader(
            rig=settings.config.name,
            simulated=settings.config.is_computed,
            model=settings.model,
            surface_hash=settings.surface.content_hash,
            calibration_ids=self._calibration_ids,
            software_version=version("haptic-driver"),
            actuator=actuator_name(settings.config),
            latency_budget_s=settings.latency_budget_s(self._shared.played.read().lead_s),
            config=settings.config.model_dump(mode="json"),
        )


def _joined(*said: str | None) -> str | None:
    """What was said, each thing once; None where nothing was."""
    return "; ".join(dict.fromkeys(one for one in said if one is not None)) or None


def _next(path: Path) -> Path:
    """The first of run-2.h5, run-3.h5, ... that is not there."""
    return next(
        there
        for number in count(2)
        if not (there := path.with_stem(f"{path.stem}-{number}")).exists()
    )
