"""Why friction is not as expected: a diagnosis of what was rendered so far, in a process of its
own.

    python -m haptic_driver.daemon.why MODEL FOLDER

diagnoses `rows.csv` of the folder, leaves its report there and says on standard output, as one JSON
line, what it is.
"""

from __future__ import annotations

import json
import sys
import threading
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from haptic_driver.daemon.event_log import EventLog
from haptic_driver.daemon.messages import RefusedError, Why
from haptic_driver.errors import HapticError
from haptic_driver.experiments.data_file import row_texts
from haptic_driver.experiments.recorded import Recorded
from haptic_driver.files import write_rows
from haptic_driver.processes.child import Child
from haptic_driver.processes.real_time import give_way
from haptic_driver.surface.models import load_model
from model.support.errors import ModelError

NAME, ROWS, PAGE = "why", "rows.csv", "report.html"
LEAST_ROWS, SUSPECTS = 12, 5
# Of friction while rendering, relative: what timing, lag and look-up leave is no noise, and a
# hundred rows share it.
LEAST_STD = 5e-3
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

    def ask(self, rows: Sequence[Recorded], model: str, *, simulated: bool) -> Why:
        """Begin to diagnose rows by the model of that name. RefusedError while another runs and for
        too few rows.
        """
        with self._lock:
            if self.answer.state == "running":
                raise RefusedError("running", "a diagnosis is running", "wait until it has ended")
            if len(rows) < LEAST_ROWS:
                said = f"{len(rows)} rows of even sliding are too few to say why"
                raise RefusedError(
                    "too_few_rows",
                    said,
                    "slide on for a minute, at several frictions or over a texture",
                )
            self._remove()
            self._folder = TemporaryDirectory(prefix="haptic-why-")
            folder, began_s = Path(self._folder.name), min(row.measured.time_s for row in rows)
            since = [
                (row, measured._replace(time_s=measured.time_s - began_s)) for row, measured in rows
            ]
            write_rows(
                folder / ROWS,
                [row_texts(row, measured, simulated=simulated) for row, measured in since],
            )
            self.answer = Why(state="running", said=f"diagnosing {len(rows)} rows", rows=len(rows))
            self._child = Child(NAME, __name__, [model, folder])
            self._waiting = threading.Thread(
                target=self._wait, args=(self._child,), name=NAME, daemon=True
            )
            self._waiting.start()
            return self.answer

    def page(self) -> str:
        """The report of the last one, HTML. RefusedError without one."""
        folder = self._folder
        if self.answer.state != "done" or folder is None:
            raise RefusedError(
                "no_report", self.answer.said, "ask first, and wait until it has ended"
            )
        return Path(folder.name, PAGE).read_text(encoding="utf-8")

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


def main() -> None:
    give_way()
    model, folder = sys.argv[1], Path(sys.argv[2])
    print(json.dumps(answer(model, folder)), flush=True)


def answer(model: str, folder: Path) -> dict[str, Any]:
    """The fields of `Why` that come of it."""
    # slow to import, and control does without
    from model.diagnosis.data import read_measurements  # noqa: PLC0415
    from model.diagnosis.workflow import diagnose  # noqa: PLC0415
    from model.reporting.page import sentence  # noqa: PLC0415
    from model.reporting.report import write_report  # noqa: PLC0415

    try:
        description = load_model(model)
        rows = replace(read_measurements(folder / ROWS), least_cof_std=LEAST_STD)
        diagnosis = diagnose(description, rows, 0, lambda step: None)
        found = write_report(diagnosis, description, folder, "what was rendered")
    except (HapticError, ModelError) as error:
        return {"state": "failed", "said": f"{error.message}. {error.hint}"}
    return {
        "state": "done",
        "said": sentence(found),
        "verdict": found["verdict"],
        "effects": [effect["name"] for effect in found["effects"]],
        "suspects": {
            each["name"]: each["probability"] for each in found["alternatives"][:SUSPECTS]
        },
        "more": list(dict.fromkeys(step["purpose"] for step in found["next_experiments"])),
        "model": found["model"],
        "report": str(folder / PAGE),
    }


if __name__ == "__main__":
    main()
