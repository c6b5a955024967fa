"""What is kept of a session: BIDS-like folders with a row per trial and its sidecar, and one table
per participant.

    DIR/dataset_description.json
    DIR/participants.tsv
    DIR/sub-P01.csv                                         every trial of P01, of all sessions
    DIR/sub-P01/ses-01/beh/sub-P01_ses-01_task-NAME_beh.tsv   a row per trial, as it is answered
    DIR/sub-P01/ses-01/beh/sub-P01_ses-01_task-NAME_beh.json  its columns, units

NAME is what of an experiment's name a file's name may have: letters and digits.

The sidecar of a task says rig, model, textures and clock as well. After the Brain Imaging Data
Structure 1.10, "Behavioral experiments": tabs, `n/a` for what is not there.
"""

from __future__ import annotations

import csv
import hashlib
import io
import json
import math
import unicodedata
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple, get_type_hints

from haptic_driver.errors import BadInputError
from haptic_driver.files import (
    open_to_add,
    whole_lines,
    write_rows,
    write_text,
    write_through,
    writing,
)
from haptic_driver.lab.psychophysics.delivery import Delivered
from model.support.cells import read_cell, written_cell
from model.support.reading import read_text

NOTHING = "n/a"

FELT_COLUMNS = {
    "asked_cof": ("friction that was asked for", "1"),
    "reachable_cof": ("friction that the rig expected to do of it", "1"),
    "felt_cof": ("friction that the force sensor measured", "1"),
    "error": ("mean of felt over asked, less 1", "1"),
    "within_5_percent": (
        "share of the sliding time with friction within 5 % of what was asked",
        "1",
    ),
    "reachable_share": ("share of the sliding time with a target within the rig's reach", "1"),
    "sliding_s": ("how long the finger slid", "s"),
    "strokes": ("how often it went more than 3 mm one way", "1"),
    "speed_m_s": ("its mean speed", "m/s"),
    "normal_force_n": ("its mean load", "N"),
}
COLUMNS = {
    "trial": ("number of the trial, from 1", "1"),
    "block": ("number of the block, from 1", "1"),
    "condition": ("name of the condition", ""),
    "practice": ("1: for practice, no part of any analysis", "1"),
    "level": ("level of the comparison, as asked", "1"),
    "felt_level": ("level by the frictions that were felt", "1"),
    "position": ("which interval had the comparison, from 1", "1"),
    "response": ("what was answered", ""),
    "positive": ("1: the comparison was chosen, or the answer was yes", "1"),
    "correct": ("1: right, 0: wrong", "1"),
    "response_time_s": (
        "from when the last interval could first be felt to the answer; from the question where"
        " nobody slid",
        "s",
    ),
    "onset_error_s": (
        "from the onset of the last interval to when the amplifier's monitor showed voltage",
        "s",
    ),
    "delivered": ("1: the rig did what was asked; only such trials are analysed", "1"),
    "why_not_delivered": ("why not", ""),
    "time_s": ("when the trial began, on CLOCK_MONOTONIC as every time of a recording", "s"),
    **{
        f"standard_{name}": (f"standard: {about}", unit)
        for name, (about, unit) in FELT_COLUMNS.items()
    },
    **{
        f"comparison_{name}": (f"comparison: {about}", unit)
        for name, (about, unit) in FELT_COLUMNS.items()
    },
}


LATER = {"onset_error_s"}  # older tables lack these columns, and stay without them
NOT_FELT = Delivered(sliding_s=math.nan, strokes=math.nan)


class Row(NamedTuple):
    """One trial as it is kept.

    `standard` is None for one interval. `felt_level` is NaN where nothing was felt,
    `onset_error_s` where no monitor showed it.
    """

    trial: int
    block: int
    condition: str
    practice: bool
    level: float
    felt_level: float
    position: int
    response: str
    positive: bool
    correct: bool | None
    response_time_s: float
    onset_error_s: float
    delivered: bool
    why_not_delivered: str
    time_s: float
    standard: Delivered | None
    comparison: Delivered

    def cells(self) -> dict[str, str]:
        """As text, by column."""
        plain = self._asdict()
        felt = {
            "standard": plain.pop("standard") or NOT_FELT,
            "comparison": plain.pop("comparison"),
        }
        every = plain | {
            f"{role}_{name}": v for role, one in felt.items() for name, v in one._asdict().items()
        }
        return {name: _cell(every[name]) for name in COLUMNS}


PLAIN = {name: kind for name, kind in get_type_hints(Row).items() if name in COLUMNS}


def row_of(cells: dict[str, str]) -> Row:
    """The row that `cells` says. ValueError where it is none."""
    cells = dict.fromkeys(LATER, NOTHING) | cells
    plain = {name: _value(cells[name], kind) for name, kind in PLAIN.items()}
    standard, comparison = (
        Delivered(
            **{
                n: _value(cells[f"{role}_{n}"], kind)
                for n, kind in get_type_hints(Delivered).items()
            }
        )
        for role in ("standard", "comparison")
    )
    return Row(**plain, standard=standard, comparison=comparison)


class SessionFiles:
    """The files of one session of one participant in a folder of results; `rows` are those that are
    there.
    """

    def __init__(self, folder: Path, participant: str, session: str, task: str) -> None:
        self.folder = folder
        self.participant, self.session, self.task = participant, session, task
        stem = f"sub-{participant}_ses-{session}_task-{label_of(task)}_beh"
        self.beh = folder / f"sub-{participant}" / f"ses-{session}" / "beh"
        self.table, self.sidecar = self.beh / f"{stem}.tsv", self.beh / f"{stem}.json"

    def rows(self) -> list[Row]:
        """Those of every whole line."""
        whole = whole_lines(self.table)
        return list(_rows(whole, self.table)) if whole else []

    def append(self, row: Row) -> None:
        """Add one, through to the disk."""
        line, there = io.StringIO(), whole_lines(self.table)
        columns = there.partition("\n")[0].split("\t") if there else list(COLUMNS)
        writer = csv.DictWriter(
            line, columns, delimiter="\t", lineterminator="\n", extrasaction="ignore"
        )
        with writing(self.table), open_to_add(self.table) as file:
            if not file.tell():
                writer.writeheader()
            writer.writerow({name: written_cell(cell) for name, cell in row.cells().items()})
            write_through(file, line.getvalue())

    def describe(self, about: Mapping[str, Any]) -> None:
        """Write the sidecar, and what the folder says of itself."""
        columns = {
            name: {"Description": said} | ({"Units": unit} if unit else {})
            for name, (said, unit) in COLUMNS.items()
        }
        write_text(
            self.sidecar, json.dumps({"TaskName": self.task, **about, **columns}, indent=1) + "\n"
        )
        top = {
            "Name": self.task,
            "BIDSVersion": "1.10.0",
            "DatasetType": "raw",
            "GeneratedBy": [{"Name": "haptic-driver"}],
        }
        write_text(self.folder / "dataset_description.json", json.dumps(top, indent=1) + "\n")
        names = sorted(path.name for path in self.folder.glob("sub-*") if path.is_dir())
        write_text(self.folder / "participants.tsv", "\n".join(["participant_id", *names]) + "\n")

    def described(self) -> dict[str, Any]:
        """The sidecar, empty where there is none. BadInputError for one that is no JSON."""
        if not self.sidecar.exists():
            return {}
        try:
            found: dict[str, Any] = json.loads(read_text(self.sidecar))
        except ValueError as error:
            raise BadInputError(
                "bad_session", f"{self.sidecar}: {error}", "Restore it, or begin another session"
            ) from error
        return found

    def write_participant(self) -> Path:
        """The participant's table, anew from all sessions; where it is."""
        path = self.folder / f"sub-{self.participant}.csv"
        found = [
            (s, r)
            for s in sessions(self.folder)
            if s.participant == self.participant
            for r in s.rows()
        ]
        if found:
            about = (
                {"participant": s.participant, "session": s.session, "task": s.task}
                for s, _ in found
            )
            write_rows(
                path, [head | row.cells() for head, (_, row) in zip(about, found, strict=True)]
            )
        return path


def sessions(folder: Path) -> list[SessionFiles]:
    """Every session of a folder of results, in order of their names."""
    found = []
    for table in sorted(folder.glob("sub-*/ses-*/beh/sub-*_ses-*_task-*_beh.tsv")):
        sub, ses, task, _ = table.stem.split("_")
        found.append(SessionFiles(folder, *(part.partition("-")[2] for part in (sub, ses, task))))
    return found


def label_of(name: str) -> str:
    """The letters and digits of ASCII in a name; for one without any, eight digits that are its
    own.
    """
    plain = unicodedata.normalize("NFKD", name).encode("ascii", "ignore").decode()
    letters = "".join(one for one in plain if one.isalnum())
    return letters or hashlib.sha256(name.encode()).hexdigest()[:8]


def _rows(text: str, path: Path) -> Iterator[Row]:
    reader = csv.DictReader(io.StringIO(text, newline=""), delimiter="\t")
    missing = [n for n in COLUMNS if n not in {*(reader.fieldnames or ()), *LATER}]
    if missing:
        said = f"{path}: has no column {', '.join(missing)}"
        raise BadInputError(
            "bad_session", said, "Give a folder that haptic experiment run has written"
        )
    for number, cells in enumerate(reader, start=2):
        try:
            yield row_of({name: read_cell(cell) for name, cell in cells.items()})
        except (TypeError, ValueError, KeyError) as error:
            raise BadInputError(
                "bad_session", f"{path}: line {number}: {error}", "Restore it from a copy"
            ) from error


def _cell(value: object) -> str:
    if value is None or value == "" or value != value:  # noqa: PLR0124 - NaN
        return NOTHING
    if isinstance(value, bool):
        return str(int(value))
    # microseconds after ten days
    return f"{value:.12g}" if isinstance(value, float) else str(value).replace("\t", " ")


def _value(cell: str, kind: Any) -> Any:
    if cell == NOTHING:
        return "" if kind is str else None if kind == bool | None else float("nan")
    if kind in (bool, bool | None):
        return bool(int(cell))
    return kind(cell)


def mean_of(felts: Sequence[Delivered]) -> Delivered | None:
    """Of the intervals that had the standard; None without one."""
    if not felts:
        return None
    return Delivered(*(sum(values) / len(felts) for values in zip(*felts, strict=True)))
