"""`haptic export`: recordings as tables."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from haptic_driver.cli.output import Json, progress, report, stdout
from haptic_driver.recording import read as recording


def export(
    file: Annotated[Path, Argument(help="Recording, HDF5.")],
    out: Annotated[Path, Option(help="Table to write: .csv or .parquet.")],
    run: Annotated[str | None, Option(help="Run, e.g. run_0001; the last one by default.")] = None,
    events: Annotated[bool, Option("--events", help="The events instead of the samples.")] = False,
    force: Annotated[bool, Option("--force", help="Overwrite what is there.")] = False,
    as_json: Json = False,
) -> None:
    """Write a run of a recording as CSV or Parquet, one row per tick.

    Example: `haptic export run.h5 --out run.csv`
    """
    runs = recording.run_names(file)
    with progress("exporting", recording.row_count(file, run, events=events)) as advance:
        rows = recording.export(file, out, run=run, events=events, force=force, progress=advance)
    payload = {
        "recording": str(file),
        "out": str(out),
        "run": run or runs[-1],
        "runs": runs,
        "rows": rows,
    }
    report(as_json, payload, lambda: stdout.print(f"{out}: {rows} rows of {payload['run']}"))
