"""`haptic why` as control asks it: a diagnosis in a process of its own."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

from haptic_driver.daemon.event_log import EventLog
from haptic_driver.daemon.messages import RefusedError, Why
from haptic_driver.errors import HapticError
from haptic_driver.live import why
from haptic_driver.live.window import Window
from haptic_driver.processes.child import Child
from haptic_driver.processes.started import start_thread

NAME = "why"
LEAST_ROWS = 12
PATIENCE_S = 900.0  # on a busy machine


class Inquiry:
    """One diagnosis at a time; `answer` is that of the last. Its files are private, and last as
    long as this does.
    """

    def __init__(self, events: EventLog) -> None:
        self.answer = Why(state="not_asked", said="nobody has asked yet")
        self._events = events
        self._child: Child | None = None
        self._folder: TemporaryDirectory[str] | None = None
        self._waiting: threading.Thread | None = None
        self._lock = threading.Lock()

    def ask(self, rows: Sequence[Window], model: str, *, simulated: bool) -> Why:
        """Begin to diagnose rows by the model of that name. RefusedError while another runs and for
        too few rows.
        """
        with self._lock:
            if self.answer.state == "running":
                raise RefusedError("running", "a diagnosis is running", "wait until it has ended")
            if len(rows) < LEAST_ROWS:
                said = f"{len(rows)} rows of even sliding are too few to say why"
                hint = "slide on for a minute, at several frictions or over a texture"
                raise RefusedError("too_few_rows", said, hint)
            self._remove()
            self._folder = TemporaryDirectory(prefix="haptic-why-")
            why.write_windows(Path(self._folder.name), rows, simulated=simulated)
            self.answer = Why(state="running", said=f"diagnosing {len(rows)} rows", rows=len(rows))
            self._child = Child(NAME, why.__name__, [model, self._folder.name])
            self._waiting = start_thread(NAME, self._wait, self._child)
            return self.answer

    def page(self) -> str:
        """The report of the last one, HTML. RefusedError without one."""
        folder = self._folder
        if self.answer.state != "done" or folder is None:
            hint = "ask first, and wait until it has ended"
            raise RefusedError("no_report", self.answer.said, hint)
        return Path(folder.name, why.PAGE).read_text(encoding="utf-8")

    def close(self) -> None:
        """End one that runs, and remove its files."""
        if self._child is not None:
            self._child.kill()
        if self._waiting is not None:
            self._waiting.join()
        self._remove()

    @property
    def pids(self) -> dict[str, int]:
        """The process id of one that runs."""
        child = self._child
        return {NAME: child.pid} if child is not None and self.answer.state == "running" else {}

    def _wait(self, child: Child) -> None:
        rows = self.answer.rows
        try:
            self.answer = Why(rows=rows, **child.ready(PATIENCE_S))
        except HapticError as error:
            self.answer = Why(state="failed", rows=rows, said=error.message)
        child.kill()
        self._events.tell(NAME, self.answer.said, verdict=self.answer.verdict)

    def _remove(self) -> None:
        if self._folder is not None:
            self._folder.cleanup()
