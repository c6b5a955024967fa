"""`haptic rows`: a lab's raw trial files as rows of measured data."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

from typer import Argument, Option

from haptic_driver.cli.output import Json, progress, report, stderr, stdout
from haptic_driver.errors import BadInputError
from haptic_driver.experiments.raw_trials.cut import Row, Trial
from haptic_driver.experiments.raw_trials.folder import Bad, TrialFolder, refuse_bad, tidied
from haptic_driver.experiments.raw_trials.propose import proposed
from haptic_driver.files import exists_already, write_rows, write_text


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
        _propose(inspect, map_file, force, as_json)
        return
    if not files or map_file is None:
        raise BadInputError(
            "usage",
            "give trial files and --map",
            "haptic rows --inspect FILE --map map.toml proposes a map",
        )
    if out.exists() and not force and not look:
        raise exists_already(out)
    folder = TrialFolder.of(files, map_file)
    picture = out.with_name(f"{out.stem}-trial.png")
    drawn = False

    def draw(trial: Trial) -> bool:
        """Draw the first trial with voltage; whether the others are not wanted."""
        nonlocal drawn
        if not drawn and trial.conditions["voltage"]:
            _draw(trial, picture)
            drawn = True
        return drawn and look

    with progress("trials", len(folder.paths)) as advance:
        found, bad = folder.rows(advance, draw)
    if not (look and drawn):
        refuse_bad(bad, len(folder.paths), leave_out=leave_out_bad and bool(found))
    if not look:
        write_rows(out, tidied(found))
    payload = _payload(out, picture if drawn else None, found, bad, len(folder.paths))
    report(as_json, payload, lambda: _show(payload, look))


def _propose(path: Path, out: Path | None, force: bool, as_json: bool) -> None:
    if out is not None and out.exists() and not force:
        raise BadInputError(
            "file_exists", f"{out}: exists already", "Give --force or another --map"
        )
    text = proposed(path)
    if out is not None:
        write_text(out, text)
    payload = {"map": None if out is None else str(out), "proposed": text}
    report(as_json, payload, lambda: stdout.print(text, end=""))


def _draw(trial: Trial, picture: Path) -> None:
    from haptic_driver.pictures.trials import (  # noqa: PLC0415  (matplotlib is slow to import)
        draw_trial,
    )

    voltage_s = None if trial.voltage is None else (trial.voltage.start_s, trial.voltage.end_s)
    draw_trial(trial.path.name, trial.columns, voltage_s, trial.spans, picture)
    stderr.print(f"{trial.path.name} with its windows: {picture}")


def _payload(
    out: Path,
    picture: Path | None,
    found: Sequence[Row],
    bad: Sequence[Bad],
    count: int,
) -> dict[str, Any]:
    return {
        "out": str(out),
        "picture": None if picture is None else str(picture),
        "rows": len(found),
        "trials": count - len(bad),
        "settings": len({row["setting"] for row in found}),
        "sessions": len({row["session"] for row in found}),
        "left_out": [{"file": str(path), "reason": error.message} for path, error in bad],
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
