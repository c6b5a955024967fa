"""`haptic export`: recordings as tables."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from haptic_driver.cli.output import Json, progress, report, stdout
from haptic_driver.errors import BadInputError
from haptic_driver.lab.strokes.file import export_strokes, is_strokes, sample_count
from haptic_driver.lab.tables import export as export_recording
from haptic_driver.lab.tables import row_count
from haptic_driver.recording.read import run_names


def export(
    file: Annotated[Path, Argument(help="Recording, or strokes of a data file, HDF5.")],
    out: Annotated[Path, Option(help="Table to write: .csv, .parquet or .mat.")],
    run: Annotated[str | None, Option(help="Run: 3, or run_0003; the last one by default.")] = None,
    every: Annotated[bool, Option("--all", help="All runs, one below the other.")] = False,
    events: Annotated[bool, Option("--events", help="The events instead of the samples.")] = False,
    force: Annotated[bool, Option("--force", help="Overwrite what is there.")] = False,
    as_json: Json = False,
) -> None:
    """Write a run of a recording, or all, as CSV, Parquet or MAT, one row per tick.

    Behind the columns of a recording stand `run`, `run_time_s` from the beginning of that run, and
    `wall_time_s`, seconds of UTC since 1970. Strokes of `haptic measure` become one row per
    reading of the force sensor.

    Example: `haptic export run.h5 --out run.csv`
    """
    if is_strokes(file):
        _export_strokes(file, out, run is not None or events or every, force, as_json)
        return
    if every and run is not None:
        raise BadInputError("usage", "--run and --all contradict each other", "Give one of them")
    runs = run_names(file)
    rows = row_count(file, run, every=every, events=events)
    with progress("exporting", rows) as advance:
        export_recording(
            file, out, run=run, every=every, events=events, force=force, progress=advance
        )
    number = run if run is None or not run.isdecimal() else f"run_{int(run):04d}"
    written = None if every else number or runs[-1]
    payload = {"recording": str(file), "out": str(out), "run": written, "runs": runs, "rows": rows}
    report(as_json, payload, lambda: stdout.print(f"{out}: {rows} rows of {_said(written, runs)}"))


def _said(written: str | None, runs: Sequence[str]) -> str:
    if written is None or len(runs) == 1:
        return ", ".join(runs)
    return f"{written}, one of {len(runs)} runs (--all takes all)"


def _export_strokes(file: Path, out: Path, of_runs: bool, force: bool, as_json: bool) -> None:
    if of_runs:
        said = f"{file}: holds strokes, which have neither runs nor events"
        raise BadInputError("usage", said, "Leave out --run, --all and --events")
    with progress("exporting", sample_count(file)) as advance:
        rows = export_strokes(file, out, force=force, progress=advance)
    payload = {"recording": str(file), "out": str(out), "rows": rows}
    report(as_json, payload, lambda: stdout.print(f"{out}: {rows} rows of strokes"))
