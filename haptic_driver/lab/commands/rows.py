"""`haptic rows`: a lab's raw trial files as rows of measured data."""

from __future__ import annotations

from dataclasses import asdict
from math import isfinite
from pathlib import Path
from typing import Annotated, Any

from rich.table import Table
from typer import Argument, Option

from haptic_driver.cli.output import Json, progress, report, stderr, stdout
from haptic_driver.errors import BadInputError
from haptic_driver.files import require_free, write_rows, write_text
from haptic_driver.lab.raw_trials.cut import Trial
from haptic_driver.lab.raw_trials.folder import Cut, TrialFolder, refuse_bad, tidied
from haptic_driver.lab.raw_trials.propose import Proposal, proposed


def rows(
    files: Annotated[
        list[Path] | None, Argument(help="Trial files, folders of them, or names with *.")
    ] = None,
    map_file: Annotated[
        Path | None, Option("--map", help="TOML: what stands where; see docs/own-data.md.")
    ] = None,
    out: Annotated[Path, Option(help="CSV to write; a picture goes beside it.")] = Path("data.csv"),
    inspect: Annotated[
        Path | None, Option(help="Propose a map for files like this one; --map says where to.")
    ] = None,
    look: Annotated[
        bool, Option("--look", help="Draw the first trial with its windows, and stop.")
    ] = False,
    leave_out_bad: Annotated[
        bool, Option("--leave-out-bad", help="Go on without files that cannot be used, and tell.")
    ] = False,
    force: Annotated[bool, Option("--force", help="Overwrite what is there.")] = False,
    as_json: Json = False,
) -> None:
    """Make rows of measured data of a lab's raw trial files, as a map says.

    Text, LabVIEW text, NPY, HDF5, MAT and TDMS, in the units that they are written in. The first
    trial is drawn with its windows before all others are read.

    Example: `haptic rows trials --map map.toml --out data.csv`
    """
    if inspect is not None:
        _propose(inspect, map_file, out, force, as_json)
        return
    if not files or map_file is None:
        raise BadInputError(
            "usage",
            "give trial files and --map",
            "haptic rows --inspect FILE --map map.toml proposes a map",
        )
    if not look:
        require_free(out, force)
    picture = out.with_name(f"{out.stem}-trial.png")
    folder = TrialFolder.of(files, map_file, [out, picture])
    drawn: list[Trial] = []

    def draw(trial: Trial) -> bool:
        """Draw the first trial, or the first with voltage; whether others are not wanted."""
        is_first = not drawn
        if is_first or (trial.voltage is not None and drawn[-1].voltage is None):
            drawn.append(trial)
            _draw(trial, picture)
        return look and trial.voltage is not None

    with progress("trials", len(folder.paths)) as advance:
        found = folder.cut(advance, draw)
    if not (look and drawn):
        refuse_bad(found, len(folder.paths), leave_out=leave_out_bad)
    if not look:
        write_rows(out, tidied(found.rows))
    payload = _payload(out, picture if drawn else None, found, len(folder.paths))
    report(as_json, payload, lambda: _show(payload, look))


def _propose(path: Path, map_file: Path | None, out: Path, force: bool, as_json: bool) -> None:
    if map_file is not None:
        require_free(map_file, force, "--map")
    found = proposed(path)
    picture = _draw_proposed(path, found, map_file or out)
    if map_file is not None:
        write_text(map_file, found.map_text)
    payload = {
        "map": None if map_file is None else str(map_file),
        "proposed": found.map_text,
        "columns": [_known(asdict(column)) for column in found.seen],
        "rate_hz": found.rate_hz,
        "taken": found.taken,
        "picture": None if picture is None else str(picture),
    }
    report(as_json, payload, lambda: _show_proposed(found, picture))


def _draw_proposed(path: Path, found: Proposal, beside: Path) -> Path | None:
    """The file with what it takes for voltage, windows, zero and sign; None without a time."""
    if "time" not in found.drawn or len(found.drawn) < 2:
        return None
    picture = beside.with_name(f"{path.stem}-inspected.png")
    from haptic_driver.lab.pictures.trials import draw_trial  # noqa: PLC0415  (slow to import)

    marks = [at_s for span in found.voltage for at_s in span[1:]]
    title = "\n".join([path.name, "; ".join(found.taken)])
    draw_trial(title, found.drawn, marks, found.spans, picture, found.as_written)
    return picture


def _known(values: dict[str, Any]) -> dict[str, Any]:
    """Numbers that are none as null."""
    return {k: None if isinstance(v, float) and not isfinite(v) else v for k, v in values.items()}


def _show_proposed(found: Proposal, picture: Path | None) -> None:
    table = Table("column", "unit", "unit from", "range", "noise", "taken for")
    for one in found.seen:
        numbers = (f"{one.low:.4g} to {one.high:.4g}", f"{one.noise:.2g}")
        table.add_row(one.name, one.unit or "?", one.unit_from, *numbers, one.role)
    stderr.print(table)
    rate = "not known" if found.rate_hz is None else f"{found.rate_hz:.6g} Hz"
    stderr.print(f"rate of samples: {rate}; the voltage comes on {len(found.voltage)} times")
    for line in found.taken:
        stderr.print(line)
    if picture is not None:
        stderr.print(f"picture: {picture}")
    stdout.print(found.map_text, end="")


def _draw(trial: Trial, picture: Path) -> None:
    # matplotlib is slow to import
    from haptic_driver.lab.pictures.trials import draw_trial  # noqa: PLC0415

    draw_trial(trial.path.name, trial.columns, (trial.voltage or ())[1:], trial.spans, picture)
    stderr.print(f"{trial.path.name} with its windows: {picture}")


def _payload(out: Path, picture: Path | None, found: Cut, count: int) -> dict[str, Any]:
    return {
        "out": str(out),
        "picture": None if picture is None else str(picture),
        "rows": len(found.rows),
        "trials": count - len(found.bad),
        "settings": len({row["setting"] for row in found.rows}),
        "sessions": len({row["session"] for row in found.rows}),
        "doubts": found.doubts_said(),
        "left_out": [{"file": str(path), "reason": error.message} for path, error in found.bad],
    }


def _show(payload: dict[str, Any], look: bool) -> None:
    if look:
        stdout.print(f"picture: {payload['picture']}")
        return
    stdout.print(
        f"{payload['out']}: {payload['rows']} rows of {payload['trials']} trials,"
        f" {payload['settings']} settings, {payload['sessions']} sessions"
    )
    for left in payload["left_out"]:
        stdout.print(f"left out, {left['reason']}")
    if payload["picture"]:
        stdout.print(f"picture: {payload['picture']}")
    for doubt in payload["doubts"]:
        stdout.print(f"doubt: {doubt}")
