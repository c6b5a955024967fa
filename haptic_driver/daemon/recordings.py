"""Runs that are recorded: begun, ended, and told of when they end by themselves."""

from __future__ import annotations

import shutil
import threading
from collections.abc import Callable
from contextlib import suppress
from importlib.metadata import version
from itertools import count
from pathlib import Path

from haptic_driver.daemon.event_log import EventLog
from haptic_driver.daemon.messages import RefusedError
from haptic_driver.daemon.set_up import DaemonSettings
from haptic_driver.errors import HapticError
from haptic_driver.processes.shared_memory import SharedState
from haptic_driver.recording.event import Event
from haptic_driver.recording.process import Recorder
from haptic_driver.recording.writer import RunHeader
from haptic_driver.rig.actuator import actuator_name

SPACE_BYTES = 32 << 20  # free before a recording goes on: two minutes of it, twice
LOOK_S = 2.0  # between looks at that


class Recordings:
    """At most one recording at a time, into which events go too. `lock` is of whoever starts or stops one.

    A recording that ends by itself goes on in another file as soon as there is space. `fault` then says why it had to,
    until it is stopped, which fails with the same. `settings` are those of the moment; `calibration_ids` by device.
    """

    def __init__(
        self, shared: SharedState, events: EventLog, settings: Callable[[], DaemonSettings],
        calibration_ids: dict[str, str],
    ) -> None:  # fmt: skip
        self.lock = threading.Lock()
        self.fault: str | None = None
        self._shared = shared
        self._events = events
        self._settings = settings
        self._calibration_ids = calibration_ids
        self._asked: Path | None = None
        self._recorder: Recorder | None = None
        self._stopped = threading.Event()  # of the present recording
        events.listener = self._note

    @property
    def path(self) -> Path | None:
        """Where to; None while nothing is recorded."""
        recorder = self._recorder
        return recorder.path if recorder is not None else None

    @property
    def pids(self) -> dict[str, int]:
        """The recorder's process id, if there is one."""
        recorder = self._recorder
        return {"recorder": recorder.pid} if recorder is not None else {}

    def start(self, path: Path) -> None:
        """Begin one. RefusedError while there is one, BadInputError for a path that cannot be used."""
        with self.lock:
            if self._asked is not None:
                raise RefusedError("recording", f"already recording into {self.path or self._asked}", "stop that first")
            self._begin(path)
            self._asked, self._stopped = path, threading.Event()

    def stop(self) -> None:
        """End it, if there is one. HapticError `recording_failed` where something of it is missing."""
        with self.lock:
            self._stopped.set()
            recorder, self._recorder = self._recorder, None
            fault, self.fault, self._asked = self.fault, None, None
            if recorder is not None:
                why = recorder.stop()
                self._events.tell("recording", f"ended: {recorder.path}" if why is None else f"ended badly: {why}")
                fault = fault or why
        if fault is not None:
            went_on = f"; then into {recorder.path}" if recorder is not None else ""
            raise HapticError("recording_failed", f"the recording is not whole: {fault}{went_on}", "look at the events")

    def watch(self) -> None:
        """One that ends by itself is told of, and goes on when it can; rendering goes on without it."""
        recorder = self._recorder
        if recorder is not None and self.lock.acquire(blocking=False):
            try:
                if recorder is self._recorder and (why := recorder.ended()) is not None:
                    self._recorder = None
                    self.fault = self.fault or why
                    self._events.tell("recording", why)
                    threading.Thread(target=self._go_on, args=(self._stopped,), name="record", daemon=True).start()
            finally:
                self.lock.release()

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

    def _note(self, event: Event) -> None:
        if self._recorder is not None:
            self._recorder.note(event)

    def _header(self) -> RunHeader:
        settings = self._settings()
        return RunHeader(
            rig=settings.config.name,
            simulated=settings.config.simulated,
            model=settings.model,
            surface_hash=settings.surface.content_hash,
            calibration_ids=self._calibration_ids,
            software_version=version("haptic-driver"),
            actuator=actuator_name(settings.config),
            latency_budget_s=settings.latency_budget_s(self._shared.played.read().lead_s),
            config=settings.config.model_dump(mode="json"),
        )


def _next(path: Path) -> Path:
    """The first of run-2.h5, run-3.h5, ... that is not there."""
    return next(there for number in count(2) if not (there := path.with_stem(f"{path.stem}-{number}")).exists())
