"""Recordings of the daemon: HDF5, readable from MATLAB, one group per run; reading them, and export
to CSV, Parquet and MAT.

`/run_0001`, `/run_0002`, ... each hold
- `samples/NAME`: one dataset per field of `processes.samples.SAMPLE`, one entry per tick. Units are
  in the names. Positions are there raw (`position_x_m`) and extrapolated to output time
  (`output_x_m`). `target_cof`, `reachable` and `expected_cof` belong to `measured_cof` beside them,
  of the moment that was felt at `felt_time_s`;
- `events/NAME`: one dataset per field of `recording.event.Event`, `data` as JSON;
- `config`: the rig's full resolved configuration, JSON;
- attributes, all strings or floats (MATLAB's h5readatt fails on integers): `rig`, `model`,
  `simulated` (1 or 0), `surface_hash`, `calibration_ids` (JSON), `software_version`, `actuator` and
  `latency_budget_s` (JSON). `started_at` is in UTC, `started_s` on CLOCK_MONOTONIC, as every time
  in a recording. `wall_offset_s` and `lsl_offset_s` are what to add to such a time for seconds of
  UTC since 1970, and for LSL's clock (NaN without LSL). `samples_lost` (overwritten before they
  were read) and `events_lost` are counts. `complete` is 1 when the recorder has ended in good order
  and nothing is missing. It is 0 while it records, after its crash or a full disk, and where
  something is missing. `why_incomplete` says which, and is empty for a run that is complete.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from haptic_driver.errors import BadInputError
from haptic_driver.files import replacing
from haptic_driver.lookup import labelled
from haptic_driver.processes.samples import ADDED, SAMPLE
from haptic_driver.recording.event import Event
from haptic_driver.recording.finish import opened
from haptic_driver.recording.structure import (
    EVENT_FIELDS,
    FIELDS,
    TABLES,
    check_run,
    member,
    read_column,
)
from haptic_driver.recording.tables import Blocks, writer_of

BLOCK_ROWS = 1 << 15  # exported at a time
# beside the columns of a run: its number, its time from its beginning, seconds of UTC since 1970
TOLD_FIELDS = ("run", "run_time_s", "wall_time_s")


@dataclass(frozen=True, repr=False)
class Run:
    """One run of a recording, in memory. `attributes` as listed above, JSON already parsed."""

    name: str
    attributes: dict[str, Any]
    config: dict[str, Any]
    samples: NDArray[np.void]
    events: list[Event]

    def __repr__(self) -> str:
        """One line, as a notebook shows what a cell ends with."""
        times_s = self.samples["time_s"]
        lasts_s = float(np.ptp(times_s)) if times_s.size else 0.0
        told = f"{times_s.size} ticks over {lasts_s:.1f} s, {len(self.events)} events"
        return f"<run {self.name}: {told}; see samples, events, config, attributes>"

    def to_frame(self) -> Any:
        """A pandas DataFrame, one row per tick; HapticError where pandas is not installed."""
        return labelled.frame({name: self.samples[name] for name in FIELDS}, self.attributes)

    def to_xarray(self) -> Any:
        """An xarray Dataset over `time_s`; HapticError where xarray is not installed."""
        values = {name: self.samples[name] for name in FIELDS if name != "time_s"}
        return labelled.dataset({"time_s": self.samples["time_s"]}, values, self.attributes)


def run_names(path: Path) -> list[str]:
    """Runs of a recording, oldest first. BadInputError when it is none."""
    with _opened(path) as file:
        return _names(file)


def read_run(path: Path, name: str | None = None) -> Run:
    """One run, the last unless named. BadInputError for a missing, damaged, foreign or newer
    file.
    """
    with _opened(path) as file:
        group = _group(path, file, name)
        samples = np.empty(group["samples/tick"].shape[0], SAMPLE)
        for field in FIELDS:
            samples[field] = _field(group["samples"], field, slice(None))
        return Run(
            group.name.strip("/"),
            _attributes(group),
            json.loads(group["config"].asstr()[()]),
            samples,
            _events(group),
        )


def export(
    path: Path,
    out: Path,
    *,
    run: str | None = None,
    every: bool = False,
    events: bool = False,
    force: bool = False,
    progress: Callable[[int], None] = lambda rows: None,
) -> int:
    """Write the samples of a run, or of `every` run (or their events), as a table; returns its
    rows. The ending of `out` chooses .csv, .parquet or .mat.

    `TOLD_FIELDS` stand behind the others. NaN is an empty cell in CSV. `progress` gets the rows
    done. BadInputError for an unknown ending, a file that exists (unless `force`) and an unreadable
    recording; HapticError when it cannot be written. All or nothing.
    """
    write = writer_of(out, force)
    with _opened(path) as file:
        groups = _groups(path, file, run, every)
        table = "events" if events else "samples"
        fields = tuple(EVENT_FIELDS) if events else FIELDS
        about = [{"run": _name(group), **_attributes(group)} for group in groups]
        said = {"recording": path.name} | ({"runs": about} if every else about[0])
        with replacing(out) as part:
            blocks = _blocks(groups, table, fields, progress)
            write(part, (*fields, *TOLD_FIELDS), blocks, said)
        return sum(_rows(group, table) for group in groups)


def row_count(
    path: Path, run: str | None = None, *, every: bool = False, events: bool = False
) -> int:
    """Samples (or events) in a run, or in `every` run."""
    with _opened(path) as file:
        table = "events" if events else "samples"
        return sum(_rows(group, table) for group in _groups(path, file, run, every))


# --- inside


@contextmanager
def _opened(path: Path) -> Iterator[h5py.File]:
    """The open file, known to be a recording; what fails while it is read is a BadInputError
    too.
    """
    try:
        with opened(path) as file:
            yield file
    except (
        OSError,
        KeyError,
        ValueError,
        RuntimeError,
        TypeError,
        RecursionError,
        MemoryError,
    ) as error:
        said = f"{path}: is damaged ({error})"
        hint = "Look at it with h5dump; use another copy"
        raise BadInputError("recording_unreadable", said, hint) from error


def _names(file: h5py.File) -> list[str]:
    return sorted(file, key=lambda name: (len(name), name))  # run_10000 comes after run_9999


def _group(path: Path, file: h5py.File, name: str | None) -> h5py.Group:
    return _groups(path, file, name, every=False)[0]


def _groups(path: Path, file: h5py.File, name: str | None, every: bool) -> list[h5py.Group]:
    names = _names(file)
    if not names:
        raise BadInputError("no_runs", f"{path}: holds no run", "Record one with: haptic record")
    if name is not None and name.isdecimal():
        name = f"run_{int(name):04d}"
    if name is not None and name not in names:
        raise BadInputError(
            "no_such_run", f"{path}: has no run {name!r}", f"It has {', '.join(names)}"
        )
    groups = [member(file, each, h5py.Group) for each in (names if every else [name or names[-1]])]
    for group in groups:
        check_run(group, TABLES, file.id.get_filesize())
    return groups


def _name(group: h5py.Group) -> str:
    return str(group.name).strip("/")


def _rows(group: h5py.Group, table: str) -> int:
    return int(group[f"{table}/time_s"].shape[0])


def _attributes(group: h5py.Group) -> dict[str, Any]:
    found = {name: _attribute(value) for name, value in group.attrs.items()}
    parsed = {
        name: json.loads(str(found[name])) for name in ("calibration_ids", "latency_budget_s")
    }
    return found | parsed | {name: bool(found[name]) for name in ("simulated", "complete")}


def _attribute(value: Any) -> str | float:
    if isinstance(value, bytes):  # of a string of fixed length
        return value.decode()
    return value if isinstance(value, str) else float(value)


def _events(group: h5py.Group) -> list[Event]:
    columns = [_column(group[f"events/{name}"], slice(None)) for name in EVENT_FIELDS]
    return [
        Event(
            number=int(number),
            time_s=float(time_s),
            kind=kind,
            message=message,
            data=json.loads(data),
        )
        for number, time_s, kind, message, data in zip(*columns, strict=True)
    ]


def _column(dataset: h5py.Dataset, rows: slice) -> NDArray[Any]:
    return read_column(dataset, rows, dataset.file.id.get_filesize())


def _field(table: h5py.Group, name: str, rows: slice) -> NDArray[Any]:
    """A column; NaN throughout where the recording is older than it."""
    if name in ADDED and name not in table:
        return np.full(table["time_s"][rows].size, np.nan)
    return _column(table[name], rows)


def _blocks(
    groups: Sequence[h5py.Group],
    name: str,
    fields: Sequence[str],
    progress: Callable[[int], None],
) -> Blocks:
    """Columns of a table of all runs, some rows at a time, at least once."""
    done = 0
    for group in groups:
        table, said = group[name], _attributes(group)
        number = int(_name(group).rpartition("_")[2])
        count = _rows(group, name)
        for start in range(0, max(count, 1), BLOCK_ROWS):
            rows = slice(start, min(start + BLOCK_ROWS, count))
            columns = [_field(table, field, rows) for field in fields]
            time_s = columns[fields.index("time_s")]
            of_run_s = time_s - said["started_s"]
            wall_s = time_s + said.get("wall_offset_s", np.nan)
            yield [*columns, np.full(time_s.size, number), of_run_s, wall_s]
            progress(done + rows.stop)
        done += count
