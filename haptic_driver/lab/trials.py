"""A lab's raw trials as rows of measured data."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from haptic_driver.files import write_rows
from haptic_driver.lab.raw_trials.columns import given_columns
from haptic_driver.lab.raw_trials.cut import Row
from haptic_driver.lab.raw_trials.folder import TrialFolder, cut_given, refuse_bad, tidied
from haptic_driver.lab.raw_trials.trial_map import made_map
from haptic_driver.lookup import labelled
from haptic_driver.public.given import bad_given, is_table
from model.support.reading import read_toml


@dataclass(frozen=True)
class TrialRows:
    """Rows of measured data, as `haptic rows` writes them.

    `doubts`: a line for each kind of thing that the trials leave in doubt. `left_out`: files that
    could not be used, and why.
    """

    rows: list[Row]
    doubts: list[str]
    left_out: list[str]

    def save(self, path: Path | str) -> Path:
        """Write the CSV that `haptic rows` writes."""
        write_rows(Path(path), self.rows)
        return Path(path)

    def to_frame(self) -> Any:
        """A pandas DataFrame, one row per window. HapticError where pandas is not installed."""
        names = list(self.rows[0]) if self.rows else []
        return labelled.frame({name: [row[name] for row in self.rows] for name in names}, {})

    def __len__(self) -> int:
        return len(self.rows)

    def __str__(self) -> str:
        return "\n".join([f"{len(self)} rows", *self.doubts, *self.left_out])


def read_rows(
    trials: Any, map: Path | str | Mapping[str, Any], *, leave_out_bad: bool = False
) -> TrialRows:
    """Cut raw trials into rows of measured data, as a map says.

    `trials`: a file, a folder, a list of files, or one trial as a DataFrame or a dict of arrays.
    Units go by name or pint. `map`: a TOML file, or the same as a dict. BadInputError names all
    that cannot be used; `leave_out_bad` goes on without such files.
    """
    if is_table(trials):
        said = map if isinstance(map, Mapping) else read_toml(Path(map))
        with bad_given("bad_trial", "the table"):
            source = given_columns(trials, "the table")
        found = cut_given(source, said)
    else:
        files = [trials] if isinstance(trials, str | Path) else list[Path | str](trials)
        paths: Sequence[Path] = [Path(file) for file in files]
        folder = (
            TrialFolder.made(paths, made_map(map))
            if isinstance(map, Mapping)
            else TrialFolder.of(paths, Path(map))
        )
        found = folder.cut()
        refuse_bad(found, len(folder.paths), leave_out=leave_out_bad)
    left_out = [error.message for _, error in found.bad]
    return TrialRows(tidied(found.rows), found.doubts_said(), left_out)
