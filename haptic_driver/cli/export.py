"""`haptic export`: recordings as tables."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from haptic_driver.cli.output import Json, progress, report, stdout
from haptic_driver.errors import BadInputError
from haptic_driver.recording import read as recording
from haptic_driver.recording.strokes import export_strokes, is_strokes, sample_count


def export(
    file: Annotated[Path, Argument(help="Recording, or strokes of a data file, HDF5.")],
    out: Annotated[Path, Option(help="Table to write: .csv or .parquet.")],
    run: Annotated[str | None, Option(help="Run, e.g. run_0001; the last one by default.")] = None,
    events: Annotated[bool, Option("--events", help="The events instead of the samples.")] = False,
    force: Annotated[bool, Option("--force", help="Overwrite what is there.")] = False,
    as_json: Json = False,
) -> None:
    """Write a run of a recording as CSV or Parquet, one row per tick.

    Strokes of `haptic measure` become one row per reading of the force sensor.

    Example: `haptic export run.h5 --out run.csv`
    """
    if is_strokes(file):
        _export_strokes(file, out, run, events, force, as_json)
        return
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


def _export_strokes(
    file: Path, out: Path, run: str | None, events: bool, force: bool, as_json: bool
) -> None:
    if run is not None or events:
        said = f"{file}: holds strokes, which have neither runs nor events"
        raise BadInputError("usage", said, "Leave out --run and --events")
    with progress("exporting", sample_count(file)) as advance:
        rows = export_strokes(file, out, force=force, progress=advance)
    payload = {"recording": str(file), "out": str(out), "rows": rows}
    report(as_json, payload, lambda: stdout.print(f"{out}: {rows} rows of strokes"))
