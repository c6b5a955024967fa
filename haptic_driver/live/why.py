"""Why friction is not as expected: a diagnosis of what was rendered so far.

    python -m haptic_driver.live.why MODEL FOLDER

diagnoses `rows.csv` of the folder, leaves its report there and says on standard output, as one JSON
line, what it is.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from haptic_driver.errors import HapticError
from haptic_driver.files import write_rows
from haptic_driver.live.window import Window, row
from haptic_driver.lookup.models import load_model
from haptic_driver.processes.real_time import give_way

ROWS, PAGE = "rows.csv", "report.html"
SUSPECTS = 5
# Of friction while rendering, relative: what timing, lag and look-up leave is no noise, and a
# hundred rows share it.
LEAST_STD = 5e-3


def write_windows(folder: Path, windows: Sequence[Window], *, simulated: bool) -> None:
    """Leave n > 0 windows in a folder to be diagnosed."""
    began_s = min(each.time_s for each in windows)
    write_rows(folder / ROWS, [row(each, began_s, simulated=simulated) for each in windows])


def answer(model: str, folder: Path) -> dict[str, Any]:
    """The fields of the daemon's `Why` that come of the rows in a folder."""
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
    except HapticError as error:
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
    give_way()
    print(json.dumps(answer(sys.argv[1], Path(sys.argv[2]))), flush=True)
