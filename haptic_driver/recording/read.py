"""Recordings of the daemon: HDF5, readable from MATLAB, one group per run.

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
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from haptic_driver.errors import BadInputError
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
    with runs_of(path, name) as [group]:
        samples = np.empty(group["samples/tick"].shape[0], SAMPLE)
        for field in FIELDS:
            samples[field] = column_of(group["samples"], field, slice(None))
        return Run(
            name_of(group),
            attributes_of(group),
            json.loads(group["config"].asstr()[()]),
            samples,
            _events(group),
        )


@contextmanager
def runs_of(path: Path, name: str | None = None, every: bool = False) -> Iterator[list[h5py.Group]]:
    """The run of that name, else the last, or `every` run: open, and checked. BadInputError."""
    with _opened(path) as file:
        names = _names(file)
        if not names:
            hint = "Record one with: haptic record"
            raise BadInputError("no_runs", f"{path}: holds no run", hint)
        if name is not None and name.isdecimal():
            name = f"run_{int(name):04d}"
        if name is not None and name not in names:
            said = f"{path}: has no run {name!r}"
            raise BadInputError("no_such_run", said, f"It has {', '.join(names)}")
        wanted = names if every else [name or names[-1]]
        groups = [member(file, each, h5py.Group) for each in wanted]
        for group in groups:
            check_run(group, TABLES, file.id.get_filesize())
        yield groups


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


def name_of(group: h5py.Group) -> str:
    """Such as run_0003."""
    return str(group.name).strip("/")


def attributes_of(group: h5py.Group) -> dict[str, Any]:
    """As listed above, JSON parsed."""
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


def column_of(table: h5py.Group, name: str, rows: slice) -> NDArray[Any]:
    """A column; NaN throughout where the recording is older than it."""
    if name in ADDED and name not in table:
        return np.full(table["time_s"][rows].size, np.nan)
    return _column(table[name], rows)
