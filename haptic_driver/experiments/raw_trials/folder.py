"""Raw trial files and their map -> rows of measured data, with all that is wrong in them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple, Self

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
from haptic_driver.experiments.raw_trials.trial_map import TrialMap, read_map
from haptic_driver.experiments.raw_trials.units import to_si
from haptic_driver.files import write_rows

MOST_LISTED = 200  # files that an error names


class Bad(NamedTuple):
    """A trial file that cannot be used, and why."""

    path: Path
    error: BadInputError


@dataclass(frozen=True)
class TrialFolder:
    """Trial files, their map, and the map's table of conditions by file."""

    paths: Sequence[Path]
    said: TrialMap
    table: Mapping[str, Mapping[str, str]]

    @classmethod
    def of(cls, files: Sequence[Path], map_file: Path) -> Self:
        """Trial files, folders of them, and names with *; BadInputError where none is there."""
        said = read_map(map_file)
        _check_units(said, map_file)
        table = tabled(said.conditions, map_file.parent)
        apart = [map_file, map_file.parent / (said.conditions.table or "")]
        return cls(_trial_files(files, apart), said, table)

    def trial(self, path: Path) -> Trial:
        """A file as a trial; BadInputError says what in it is not as the map says."""
        conditions = conditions_of(path, self.said.conditions, self.table)
        return read_trial(path, self.said, conditions)

    def rows(
        self,
        progress: Callable[[int], None] = lambda done: None,
        look: Callable[[Trial], bool] = lambda trial: False,
    ) -> tuple[list[Row], list[Bad]]:
        """The rows of all trials, and the files that have none; `look` may end it at a trial."""
        found, bad = list[Row](), list[Bad]()
        for number, path in enumerate(self.paths, start=1):
            try:
                trial = self.trial(path)
                if look(trial):
                    break
                found += rows_of(trial, self.said, number)
            except BadInputError as error:
                bad.append(Bad(path, error))
            progress(number)
        return found, bad


def write_trials(
    files: Sequence[Path], map_file: Path, out: Path, *, leave_out_bad: bool = False
) -> list[Bad]:
    """Write the rows of trial files to a CSV; returns what was left out, where that is allowed.

    BadInputError names every file that cannot be used.
    """
    folder = TrialFolder.of(files, map_file)
    found, bad = folder.rows()
    refuse_bad(bad, len(folder.paths), leave_out=leave_out_bad and bool(found))
    write_rows(out, tidied(found))
    return bad


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


def refuse_bad(bad: Sequence[Bad], count: int, *, leave_out: bool) -> None:
    """BadInputError that says all that is wrong with files, unless they may be left out."""
    if leave_out or not bad:
        return
    hints = list(dict.fromkeys(error.hint for _, error in bad if error.hint))
    hint = "\n".join([*hints, "To go on without such files: --leave-out-bad"])
    if len(bad) == 1:
        raise BadInputError(bad[0].error.code, bad[0].error.message, hint)
    listed = [error.message for _, error in bad]
    more = f"; and {len(listed) - MOST_LISTED} more" if len(listed) > MOST_LISTED else ""
    said = f"{len(bad)} of {count} files cannot be used: {'; '.join(listed[:MOST_LISTED])}{more}"
    raise BadInputError("bad_trial", said, hint)


def tidied(found: Sequence[Row]) -> list[Row]:
    """The rows without columns that are empty throughout."""
    said = [name for name in COLUMNS if any(row[name] != "" for row in found)]
    return [{name: _text(row[name]) for name in said} for row in found]


def _text(value: str | float) -> str:
    return value if isinstance(value, str) else f"{value:.9g}"
