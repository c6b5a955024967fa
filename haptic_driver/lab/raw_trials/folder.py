"""Raw trial files and their map -> rows of measured data, with all that is wrong in them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple, Self

from haptic_driver.errors import BadInputError
from haptic_driver.files import listed, write_rows
from haptic_driver.lab.raw_trials.columns import KINDS, Source
from haptic_driver.lab.raw_trials.cut import (
    COLUMNS,
    Row,
    Trial,
    conditions_of,
    opened,
    read_trials,
    rows_of,
    tabled,
)
from haptic_driver.lab.raw_trials.look import Doubt
from haptic_driver.lab.raw_trials.plausible import doubts_of
from haptic_driver.lab.raw_trials.quantities import given_roles
from haptic_driver.lab.raw_trials.trial_map import TrialMap, made_map, read_map
from model.support.units import to_si

MOST_LISTED = 200  # files that an error names
MOST_NAMED = 3  # files that a line of doubts names
DONE = {
    "aliased": "the electrode's voltage is sampled below twice its frequency",
    "burst": "the voltage comes on several times: a trial for each",
    "clipped": "a force has hardly any noise at an end of its range: is it clipped?",
    "flat": "a force is the same number throughout a window",
    "frozen": "a force stood still for a part of a window, which was left out",
    "from_start": "the voltage is on from the first sample: an offset, or a window too late",
    "gap": "samples are missing in a window",
    "impossible": "a number is outside of what a touch can have: is a unit or a gain wrong?",
    "not_as_set": "what was measured is far from what was set: is a unit or a gain wrong?",
    "outliers": "samples far outside the noise were left out",
    "spike": "a spike of the voltage was passed over",
    "turn": "the finger turns in a window: lateral force counts against its way",
    "zero": "the lateral force is not zero without load",
}


class Bad(NamedTuple):
    """A trial file that cannot be used, and why."""

    path: Path
    error: BadInputError


class Doubted(NamedTuple):
    """A trial file that is used, and what it leaves in doubt."""

    path: Path
    doubt: Doubt


class Cut(NamedTuple):
    """The rows of trial files, the files that have none, and what others leave in doubt."""

    rows: list[Row]
    bad: list[Bad]
    doubted: list[Doubted]

    def doubts_said(self) -> list[str]:
        """A line for each kind of doubt: in how many files, in which, and what was done."""
        lines = []
        for kind, done in DONE.items():
            names = list(dict.fromkeys(p.name for p, doubt in self.doubted if doubt.kind == kind))
            if names:
                more = f" and {len(names) - MOST_NAMED} more" if len(names) > MOST_NAMED else ""
                which = ", ".join(names[:MOST_NAMED])
                lines.append(f"{done}, in {len(names)} files ({which}{more})")
        return lines


@dataclass(frozen=True)
class TrialFolder:
    """Trial files, their map, and the map's table of conditions by file."""

    paths: Sequence[Path]
    said: TrialMap
    table: Mapping[str, Mapping[str, str]]

    @classmethod
    def of(cls, files: Sequence[Path], map_file: Path, own: Sequence[Path] = ()) -> Self:
        """Trial files, folders of them, and names with *; BadInputError where none is there.

        `own`: what is written there and is no trial.
        """
        said = read_map(map_file)
        _check_units(said, str(map_file))
        table = tabled(said.conditions, map_file.parent)
        apart = [map_file, map_file.parent / (said.conditions.table or ""), *own]
        return cls(_trial_files(files, apart), said, table)

    @classmethod
    def made(cls, files: Sequence[Path], said: TrialMap) -> Self:
        """Trial files by a map that stands in no file."""
        _check_units(said, "the map")
        return cls(_trial_files(files, []), said, tabled(said.conditions, Path()))

    def trials(self, path: Path, *, may_turn: bool = False) -> list[Trial]:
        """A file as trials; BadInputError says what in it is not as the map says."""
        conditions = conditions_of(path, self.said.conditions, self.table)
        source = opened(path, self.said)
        return read_trials(source, self.said, conditions, may_turn=may_turn)

    def cut(
        self,
        progress: Callable[[int], None] = lambda done: None,
        look: Callable[[Trial], bool] = lambda trial: False,
    ) -> Cut:
        """The rows of all trials; `look` may end it at a trial."""
        found = Cut([], [], [])
        for done, path in enumerate(self.paths, start=1):
            try:
                trials = self.trials(path)
                if any(look(trial) for trial in trials):
                    break
                _add(found, path, trials, self.said)
            except BadInputError as error:
                found.bad.append(Bad(path, error))
            progress(done)
        return found


def cut_given(source: Source, map_values: Mapping[str, Any]) -> Cut:
    """The rows of a trial in memory, by a map as a dict; BadInputError as for a file."""
    said = made_map(map_values)
    _check_units(said, "the map")
    conditions = conditions_of(source.path, said.conditions, {})
    found = Cut([], [], [])
    _add(found, source.path, read_trials(source, said, conditions), said)
    return found


def _add(found: Cut, path: Path, trials: Sequence[Trial], said: TrialMap) -> None:
    number = len({row["trial"] for row in found.rows}) + len(found.bad)
    rows = [rows_of(trial, said, number + i) for i, trial in enumerate(trials, start=1)]
    found.doubted.extend(Doubted(path, doubt) for trial in trials for doubt in trial.doubts)
    for row in (row for each in rows for row in each):
        doubts = list(doubts_of(row))
        row["doubts"] = "; ".join(filter(None, [str(row["doubts"]), *(d.said for d in doubts)]))
        found.doubted.extend(Doubted(path, doubt) for doubt in doubts)
        found.rows.append(row)


def write_trials(
    files: Sequence[Path], map_file: Path, out: Path, *, leave_out_bad: bool = False
) -> Cut:
    """Write the rows of trial files to a CSV; returns them with what was left out, where that is
    allowed.

    BadInputError names every file that cannot be used.
    """
    folder = TrialFolder.of(files, map_file, [out])
    found = folder.cut()
    refuse_bad(found, len(folder.paths), leave_out=leave_out_bad)
    write_rows(out, tidied(found.rows))
    return found


def _check_units(said: TrialMap, where: str) -> None:
    """BadInputError for a unit of the map that no file has to be read for."""
    for role, column in given_roles(said).items():
        if column.unit is not None:
            to_si(role, column.unit, f"{where}: columns.{role}.unit", column.gain_unit)
    for name, unit in said.conditions.units.items():
        to_si(name, unit, f"{where}: conditions.units.{name}")


def _trial_files(given: Sequence[Path], apart: Sequence[Path]) -> list[Path]:
    """The files of folders and names with *, in the order of their names; `apart` are none."""
    found: list[Path] = []
    for path in given:
        if path.is_dir():
            found += listed(path, KINDS, apart)
        elif "*" in path.name and not path.exists():
            inside = listed(path.parent, KINDS, apart) if path.parent.is_dir() else []
            found += [each for each in inside if each.match(path.name)]
        else:
            if not path.exists():
                raise BadInputError("file_not_found", f"{path}: there is no such file", "Check it")
            found.append(path)
    kept = list(dict.fromkeys(found))
    if not kept:
        said = f"{', '.join(map(str, given))}: no trial file is there"
        raise BadInputError("file_not_found", said, f"Known endings: {', '.join(KINDS)}")
    return kept


def refuse_bad(found: Cut, count: int, *, leave_out: bool) -> None:
    """BadInputError that says all that is wrong with files, unless they may be left out."""
    bad = found.bad
    if (leave_out and found.rows) or not bad:
        return
    hints = list(dict.fromkeys(error.hint for _, error in bad if error.hint))
    hint = "\n".join([*hints, "To go on without such files: --leave-out-bad"])
    if len(bad) == 1:
        raise BadInputError(bad[0].error.code, bad[0].error.message, hint)
    listed_bad = [error.message for _, error in bad]
    more = f"; and {len(bad) - MOST_LISTED} more" if len(bad) > MOST_LISTED else ""
    told = "; ".join(listed_bad[:MOST_LISTED])
    said = f"{len(bad)} of {count} files cannot be used: {told}{more}"
    raise BadInputError("bad_trial", said, hint)


def tidied(found: Sequence[Row]) -> list[Row]:
    """The rows without columns that are empty throughout."""
    said = [name for name in COLUMNS if any(row[name] != "" for row in found)]
    return [{name: _text(row[name]) for name in said} for row in found]


def _text(value: str | float) -> str:
    return value if isinstance(value, str) else f"{value:.9g}"
