"""`haptic rows`: a lab's raw trial files as rows of measured data."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

from typer import Argument, Option

from haptic_driver.cli.output import Json, progress, report, stderr, stdout
from haptic_driver.errors import BadInputError
from haptic_driver.experiments.raw_trials.columns import KINDS
from haptic_driver.experiments.raw_trials.cut import (
    COLUMNS,
    Row,
    Trial,
    conditions_of,
    read_trial,
    rows_of,
    tabled,
)
from haptic_driver.experiments.raw_trials.propose import proposed
from haptic_driver.experiments.raw_trials.trial_map import TrialMap, read_map
from haptic_driver.experiments.raw_trials.units import to_si
from haptic_driver.files import exists_already, write_rows, write_text

MOST_LISTED = 200  # files that an error names


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
    said = read_map(map_file)
    _check_units(said, map_file)
    table = tabled(said.conditions, map_file.parent)
    paths = _trial_files(files, [map_file, map_file.parent / (said.conditions.table or "")])
    picture = out.with_name(f"{out.stem}-trial.png")
    found, bad, drawn = list[Row](), list[tuple[Path, BadInputError]](), False
    with progress("trials", len(paths)) as advance:
        for number, path in enumerate(paths, start=1):
            try:
                trial = read_trial(path, said, conditions_of(path, said.conditions, table))
                if not drawn and trial.conditions["voltage"]:
                    _draw(trial, picture)
                    drawn = True
                    if look:
                        break
                found += rows_of(trial, said, number)
            except BadInputError as error:
                bad.append((path, error))
            advance(number)
    if bad and not (leave_out_bad and found) and not (look and drawn):
        raise _refused(bad, len(paths))
    if not look:
        write_rows(out, _with_what_is_said(found))
    payload = _payload(out, picture if drawn else None, found, bad, len(paths))
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


def _check_units(said: TrialMap, map_file: Path) -> None:
    """BadInputError for a unit of the map that no file has to be read for."""
    for role in type(said.columns).model_fields:
        column = getattr(said.columns, role)
        if column is not None and column.unit is not None:
            to_si(role, column.unit, f"{map_file}: columns.{role}.unit", column.gain_unit)
    for name, unit in said.conditions.units.items():
        to_si(name, unit, f"{map_file}: conditions.units.{name}")


def _trial_files(given: Sequence[Path], apart: Sequence[Path]) -> list[Path]:
    """The files of folders and names with *, in the order of their names; `apart` are none."""
    found: list[Path] = []
    for path in given:
        if path.is_dir():
            inside = sorted(path.iterdir())
            found += [each for each in inside if each.suffix.lower() in KINDS and each.is_file()]
        elif "*" in path.name and not path.exists():
            found += sorted(path.parent.glob(path.name))
        else:
            if not path.exists():
                raise BadInputError("file_not_found", f"{path}: there is no such file", "Check it")
            found.append(path)
    left = {each.resolve() for each in apart}
    kept = [path for path in dict.fromkeys(found) if path.resolve() not in left]
    if not kept:
        said = f"{', '.join(map(str, given))}: no trial file is there"
        raise BadInputError("file_not_found", said, f"Known endings: {', '.join(KINDS)}")
    return kept


def _draw(trial: Trial, picture: Path) -> None:
    from haptic_driver.pictures.trials import (  # noqa: PLC0415  (matplotlib is slow to import)
        draw_trial,
    )

    voltage_s = None if trial.voltage is None else (trial.voltage.start_s, trial.voltage.end_s)
    draw_trial(trial.path.name, trial.columns, voltage_s, trial.spans, picture)
    stderr.print(f"{trial.path.name} with its windows: {picture}")


def _refused(bad: Sequence[tuple[Path, BadInputError]], count: int) -> BadInputError:
    """All that is wrong with files, as one error."""
    hints = list(dict.fromkeys(error.hint for _, error in bad if error.hint))
    hint = "\n".join([*hints, "To go on without such files: --leave-out-bad"])
    if len(bad) == 1:
        return BadInputError(bad[0][1].code, bad[0][1].message, hint)
    listed = [error.message for _, error in bad]
    more = f"; and {len(listed) - MOST_LISTED} more" if len(listed) > MOST_LISTED else ""
    said = f"{len(bad)} of {count} files cannot be used: {'; '.join(listed[:MOST_LISTED])}{more}"
    return BadInputError("bad_trial", said, hint)


def _with_what_is_said(found: Sequence[Row]) -> list[Row]:
    """The rows without columns that are empty throughout."""
    said = [name for name in COLUMNS if any(row[name] != "" for row in found)]
    return [{name: _text(row[name]) for name in said} for row in found]


def _text(value: str | float) -> str:
    return value if isinstance(value, str) else f"{value:.9g}"


def _payload(
    out: Path,
    picture: Path | None,
    found: Sequence[Row],
    bad: Sequence[tuple[Path, BadInputError]],
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
