"""What the recorder writes, and how a run survives a crash; the format is described in `read.py`.

HDF5 has no journal: a process that is killed while it writes leaves a file that nobody can open. So nobody ever writes
to the file that the user sees. There are two copies; the hidden one is brought up to date, closed, forced to disk and
exchanged with the visible one by renaming, which happens as a whole or not at all. Whenever the recorder dies and
however full the disk gets, the visible file is a complete HDF5 file that lacks at most what came since the last
exchange. The price is twice the space while recording. Nothing is exchanged of which the system has refused a byte
(`checked_file.py`).
"""

from __future__ import annotations

import datetime
import json
import math
import os
import shutil
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from haptic_driver.errors import BadInputError, HapticError
from haptic_driver.processes.samples import SAMPLE
from haptic_driver.processes.shared_memory import Taken
from haptic_driver.recording.checked_file import CheckedFile
from haptic_driver.recording.clock import ClockOffsets, clock_offsets
from haptic_driver.recording.event import Event
from haptic_driver.recording.read import EVENT_FIELDS, FIELDS, FORMAT, FORMAT_VERSION, run_names

INTERVAL_S = 0.5  # between exchanges; what a crash may cost
CHUNK_ROWS = 4096
PRIVATE = 0o600
WHY_BYTES = 240
NOT_ENDED = "it is being recorded, or its recorder was killed"


@dataclass(frozen=True)
class RunHeader:
    """What was true of the whole run; see `haptic_driver.recording.read`. `calibration_ids` by device."""

    rig: str
    simulated: bool
    model: str
    surface_hash: str
    calibration_ids: dict[str, str]
    software_version: str
    actuator: str
    latency_budget_s: dict[str, float]
    config: dict[str, Any]
    started_s: float = field(default_factory=time.monotonic)
    started_at: str = field(default_factory=lambda: datetime.datetime.now(datetime.UTC).isoformat())
    clock: ClockOffsets = field(default_factory=clock_offsets)

    def attributes(self) -> dict[str, str | float | NDArray[np.bytes_]]:
        """Strings and floats."""
        said = {name: value for name, value in vars(self).items() if name not in ("config", "clock")}
        found = {name: json.dumps(value) if isinstance(value, dict) else value for name, value in said.items()}
        offsets_s = {name: math.nan if s is None else s for name, s in self.clock}
        said_last = {"samples_lost": 0.0, "complete": 0.0, "why_incomplete": _of_fixed_length(NOT_ENDED)}
        return found | offsets_s | {"simulated": float(self.simulated)} | said_last


@dataclass(frozen=True)
class Chunk:
    """What came since the last time: samples of dtype SAMPLE, how many are missing before them, and events."""

    samples: NDArray[np.void]
    lost: int
    events: Sequence[Event]


class RunWriter:
    """One new run at the end of a recording, which is made, private, where there is none.

    Raises BadInputError for a path that cannot be used, HapticError `recording_failed` when writing fails; the visible
    file is readable whatever happens.
    """

    def __init__(self, path: Path, header: RunHeader) -> None:
        self.path = checked_path(path)
        self._behind = hidden_copy(self.path)
        self._owed: list[Chunk] = []  # what the hidden copy lacks
        self.samples = 0
        try:
            self._run = self._begin(header)
        except (OSError, RuntimeError) as error:
            remove_hidden(self.path)
            said = f"{path}: cannot be written ({self._said(error)})"
            raise BadInputError("recording_not_made", said, "Choose a file on a local disk with space") from error

    def append(self, chunk: Chunk) -> None:
        """Write one more piece through to the disk."""
        self._write([*self._owed, chunk], complete=False)
        self._owed = [chunk]
        self.samples += len(chunk.samples)

    def close(self) -> None:
        """Mark the run as complete and remove the hidden copy."""
        self._write(self._owed, complete=True)
        remove_hidden(self.path)

    def _begin(self, header: RunHeader) -> str:
        remove_hidden(self.path)
        is_new = not self.path.exists()
        if is_new:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            os.close(os.open(self._behind, os.O_CREAT | os.O_EXCL | os.O_WRONLY, PRIVATE))
        else:
            _copy(self.path, self._behind)
        with _written(self._behind, "w" if is_new else "r+") as file:
            file.attrs["format"], file.attrs["format_version"] = FORMAT, FORMAT_VERSION
            name = f"run_{len(file) + 1:04d}"
            _make_run(file.create_group(name), header)
        if is_new:
            os.link(self._behind, self.path)  # fails, unlike renaming, where a file has appeared
            os.unlink(self._behind)
        else:
            os.replace(self._behind, self.path)
        _copy(self.path, self._behind)
        return name

    def _write(self, chunks: Iterable[Chunk], complete: bool) -> None:
        try:
            with _written(self._behind, "r+") as file:
                group = file[self._run]
                for chunk in chunks:
                    _append(group, chunk)
                if complete:
                    group.attrs["complete"], group.attrs["why_incomplete"] = 1.0, _of_fixed_length("")
            self._exchange()
        except (OSError, RuntimeError, KeyError) as error:
            self._say_why(f"recording stopped: {self._said(error)}")
            said = f"{self.path}: recording stopped, what came before is kept ({self._said(error)})"
            raise HapticError("recording_failed", said, "Make room on the disk, or choose another one") from error

    def _say_why(self, reason: str) -> None:
        """Where `NOT_ENDED` stands in the visible file: in its place, since a full disk has room for nothing more."""
        remove_hidden(self.path)
        with suppress(OSError, RuntimeError, KeyError), _written(self.path, "r+") as file:
            file[self._run].attrs.modify("why_incomplete", _of_fixed_length(reason))

    def _exchange(self) -> None:
        """Killed anywhere here, the visible file is the old one or the new one."""
        spare = _spare(self._behind)
        os.link(self.path, spare)
        os.replace(self._behind, self.path)
        os.replace(spare, self._behind)

    def _said(self, error: Exception) -> str:
        """What went wrong, without the name of a file that nobody has asked for."""
        return str(error).replace(str(self._behind), str(self.path))


def record(writer: RunWriter, drain: Callable[[], Taken], wait: Callable[[], tuple[Sequence[Event], bool]]) -> None:
    """Write until `wait` says that it is over; `wait` lasts up to `INTERVAL_S` and returns the events of that time.

    The first HapticError ends it, with what was written before still readable.
    """
    try:
        over = False
        while not over:
            events, over = wait()
            taken = drain()
            writer.append(Chunk(taken.samples, taken.lost, events))
        writer.close()
    except BaseException:
        remove_hidden(writer.path)
        raise


def checked_path(path: Path) -> Path:
    """Where to record, with nothing there but a recording. BadInputError otherwise."""
    resolved = where(path)
    if resolved.exists():
        run_names(resolved)  # reads it
    return resolved


def where(path: Path) -> Path:
    """Where to record: absolute, ending in .h5 or .hdf5. BadInputError otherwise."""
    if path.suffix.lower() not in (".h5", ".hdf5"):
        raise BadInputError("bad_ending", f"{path}: a recording's name ends in .h5", "Give a name such as run.h5")
    if not path.is_absolute():
        raise BadInputError("relative_path", f"{path}: the daemon works in another folder", "Give an absolute path")
    return path.resolve()


def hidden_copy(path: Path) -> Path:
    """The copy that is being written to."""
    return path.with_name(f".{path.name}.behind")


def remove_hidden(path: Path) -> None:
    """Remove what a recorder of `path` leaves behind when it dies."""
    for left in (hidden_copy(path), _spare(hidden_copy(path))):
        with suppress(OSError):
            left.unlink(missing_ok=True)


def _spare(behind: Path) -> Path:
    return behind.with_name(f"{behind.name}.spare")


def _copy(source: Path, target: Path) -> None:
    shutil.copyfile(source, target)
    os.chmod(target, source.stat().st_mode)


@contextmanager
def _written(path: Path, mode: str) -> Iterator[h5py.File]:
    """The open file; at the end of the block it is on the disk, or an OSError is raised."""
    with CheckedFile(path) as raw, h5py.File(raw, mode) as file:
        yield file


def _of_fixed_length(said: str) -> NDArray[np.bytes_]:
    """A string that another takes the place of without a byte more."""
    return np.array(said.encode("ascii", "replace")[:WHY_BYTES], f"S{WHY_BYTES}")


def _make_run(group: h5py.Group, header: RunHeader) -> None:
    for name, value in header.attributes().items():
        group.attrs[name] = value
    group.create_dataset("config", data=json.dumps(header.config), dtype=h5py.string_dtype())
    for name in FIELDS:
        _empty(group, f"samples/{name}", SAMPLE[name])
    for name, kind in EVENT_FIELDS.items():
        _empty(group, f"events/{name}", kind)


def _empty(group: h5py.Group, name: str, kind: Any) -> None:
    group.create_dataset(name, (0,), kind, maxshape=(None,), chunks=(CHUNK_ROWS if name.startswith("samples") else 64,))


def _append(group: h5py.Group, chunk: Chunk) -> None:
    for name in FIELDS:
        _extend(group[f"samples/{name}"], chunk.samples[name])
    rows = [(e.number, e.time_s, e.kind, e.message, json.dumps(e.data)) for e in chunk.events]
    for i, name in enumerate(EVENT_FIELDS):
        _extend(group[f"events/{name}"], [row[i] for row in rows])
    group.attrs["samples_lost"] = float(group.attrs["samples_lost"]) + chunk.lost


def _extend(dataset: h5py.Dataset, values: Any) -> None:
    if len(values):
        before = dataset.shape[0]
        dataset.resize(before + len(values), axis=0)
        dataset[before:] = values
