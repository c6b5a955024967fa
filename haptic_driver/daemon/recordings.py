"""Runs that are recorded: begun, ended, and told of when they end by themselves."""

from __future__ import annotations

import threading
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path

from haptic_driver.daemon.event_log import EventLog
from haptic_driver.daemon.messages import RefusedError
from haptic_driver.daemon.set_up import DaemonSettings
from haptic_driver.processes.shared_memory import SharedState
from haptic_driver.recording.event import Event
from haptic_driver.recording.process import Recorder
from haptic_driver.recording.writer import RunHeader
from haptic_driver.rig.actuator import actuator_name


class Recordings:
    """At most one run at a time, into which events go too. `lock` is of whoever starts or stops one.

    `settings` are those of the moment; `calibration_ids` by device.
    """

    def __init__(
        self, shared: SharedState, events: EventLog, settings: Callable[[], DaemonSettings],
        calibration_ids: dict[str, str],
    ) -> None:  # fmt: skip
        self.lock = threading.Lock()
        self._shared = shared
        self._events = events
        self._settings = settings
        self._calibration_ids = calibration_ids
        self._recorder: Recorder | None = None
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
        """Begin a run. RefusedError while there is one, BadInputError for a path that cannot be used."""
        with self.lock:
            if self._recorder is not None:
                raise RefusedError("recording", f"already recording into {self._recorder.path}", "stop that first")
            self._recorder = Recorder(path, self._header(), self._shared)
            self._events.tell("recording", f"into {self._recorder.path}")

    def stop(self) -> None:
        """End the run, if there is one."""
        with self.lock:
            self.end()

    def end(self) -> None:
        """The same where nobody else can start or stop one."""
        recorder, self._recorder = self._recorder, None
        if recorder is not None:
            why = recorder.stop()
            self._events.tell("recording", f"ended: {recorder.path}" if why is None else f"ended badly: {why}")

    def watch(self) -> None:
        """A recording that ends by itself is told of; rendering goes on without it."""
        recorder = self._recorder
        if recorder is not None and self.lock.acquire(blocking=False):
            try:
                if recorder is self._recorder and (why := recorder.ended()) is not None:
                    self._recorder = None
                    self._events.tell("recording", why)
            finally:
                self.lock.release()

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
            latency_budget_s=settings.latency_budget_s,
            config=settings.config.model_dump(mode="json"),
        )
