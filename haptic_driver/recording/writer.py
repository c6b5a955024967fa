"""What the recorder writes, and how a run survives a crash; the format is described in `read.py`.

HDF5 has no journal: a process that is killed while it writes leaves a file that nobody can open. So
nobody ever writes to the file that the user sees. There are two copies; the hidden one is brought
up to date, closed, forced to disk and exchanged with the visible one by renaming, which happens as
a whole or not at all. Whenever the recorder dies and however full the disk gets, the visible file
is a complete HDF5 file that lacks at most what came since the last exchange. The price is twice the
space while recording. Nothing is exchanged of which the system has refused a byte
(`checked_file.py`).

Who deletes one of the two loses nothing: it is put back from the other, and both from the
descriptor of the visible file, which is kept open. A run of which ticks or events are missing never
says that it is complete.
"""

from __future__ import annotations

import datetime
import errno
import json
import math
import os
import shutil
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from itertools import count
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
    """What was true of the whole run; see `haptic_driver.recording.read`. `calibration_ids` by
    device.
    """

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
        said = {
            name: value for name, value in vars(self).items() if name not in ("config", "clock")
        }
        found = {
            name: json.dumps(value) if isinstance(value, dict) else value
            for name, value in said.items()
        }
        offsets_s = {name: math.nan if s is None else s for name, s in self.clock}
        said_last = {"samples_lost": 0.0, "events_lost": 0.0, "complete": 0.0}
        why = {"why_incomplete": _of_fixed_length(NOT_ENDED)}
        return found | offsets_s | {"simulated": float(self.simulated)} | said_last | why


@dataclass(frozen=True)
class Chunk:
    """What came since the last time: samples of dtype SAMPLE, how many are missing before them, and
    events.
    """

    samples: NDArray[np.void]
    lost: int
    events: Sequence[Event]


class EventCount:
    """Which numbers of events have come: they count up without gaps, though not always in order."""

    def __init__(self) -> None:
        self._first = self._last = self._count = 0

    def add(self, events: Sequence[Event]) -> None:
        for event in events:
            self._first = min(self._first, event.number) if self._count else event.number
            self._last = max(self._last, event.number)
            self._count += 1

    @property
    def missing(self) -> int:
        """How many lie between the first and the last and have not come."""
        return self._last - self._first + 1 - self._count if self._count else 0


class RunWriter:
    """One new run at the end of a recording, which is made, private, where there is none.

    Raises BadInputError for a path that cannot be used, HapticError `recording_failed` when writing
    fails; the visible file is readable whatever happens.
    """

    def __init__(self, path: Path, header: RunHeader) -> None:
        self.path = checked_path(path)
        self._behind = hidden_copy(self.path)
        self._owed: list[Chunk] = []  # what the hidden copy lacks
        self._whole = -1  # a descriptor of the visible file
        self._news: list[str] = []
        self._events = EventCount()
        self.samples = 0
        self.lost = 0
        try:
            self._run = self._begin(header)
        except (OSError, RuntimeError) as error:
            remove_hidden(self.path)
            said = f"{path}: cannot be written ({self._said(error)})"
            raise BadInputError("recording_not_made", said, what_to_do(error)) from error

    def append(self, chunk: Chunk) -> None:
        """Write one more piece through to the disk."""
        self.lost += chunk.lost
        self._events.add(chunk.events)
        self._write(chunk)
        self.samples += len(chunk.samples)

    def close(self) -> str | None:
        """Mark the run as complete, or as what it lacks, and remove the hidden copy; what it lacks,
        in words.
        """
        self._write(None)
        remove_hidden(self.path)
        os.close(self._whole)
        return self._lacks()

    @property
    def missing(self) -> str | None:
        """Which ticks the run lacks so far, in words; None where none is missing. Events may come
        late.
        """
        return _missing(self.path, self.lost, 0)

    def _lacks(self) -> str | None:
        return _missing(self.path, self.lost, self._events.missing)

    def news(self) -> list[str]:
        """What has happened to its files since the last time, in words."""
        said, self._news = self._news, []
        return said

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
        self._hold()
        return name

    def _write(self, chunk: Chunk | None) -> None:
        """What the hidden copy lacks, and one chunk more, or the end."""
        try:
            if not self._behind.exists():
                self._put_hidden_back()
            with _written(self._behind, "r+") as file:
                group = file[self._run]
                for one in (*self._owed, *([] if chunk is None else [chunk])):
                    _append(group, one)
                group.attrs["events_lost"] = float(self._events.missing)
                if chunk is None:
                    group.attrs["complete"] = float(self._lacks() is None)
                    group.attrs["why_incomplete"] = _of_fixed_length(self._lacks() or "")
            is_behind = self._exchange()
            self._owed = [chunk] if chunk is not None and is_behind else []
            self._hold()
        except (OSError, RuntimeError, KeyError) as error:
            reason = self._said(error)
            said = f"{self.path}: recording stopped ({reason}), {self._keep(reason)}"
            raise HapticError("recording_failed", said, what_to_do(error)) from error

    def _exchange(self) -> bool:
        """Killed anywhere here, the visible file is the old one or the new one. Whether a chunk is
        owed afterwards.
        """
        spare = _spare(self._behind)
        try:
            if not self._is_ours(self.path):
                raise FileExistsError(
                    errno.EEXIST, "another file has taken its place", str(self.path)
                )
            os.link(self.path, spare)
        except FileNotFoundError:
            os.link(self._behind, self.path)
            _copy(self.path, spare)
            is_behind = False
            self._news.append(
                f"{self.path} was deleted while it is recorded, and is put back, whole"
            )
        else:
            os.replace(self._behind, self.path)
            is_behind = True
        os.replace(spare, self._behind)
        return is_behind

    def _put_hidden_back(self) -> None:
        """As it would be without a chunk to come: the visible file lacks none."""
        self.path.parent.mkdir(parents=True, exist_ok=True)
        _copy_open(self._whole, self._behind)
        self._owed = []

    def _keep(self, reason: str) -> str:
        """Say in what is left why it ends: in place, since a full disk has room for nothing more;
        where that is.
        """
        remove_hidden(self.path)
        where = self.path
        try:
            if not self._is_ours(where):
                where = _free_name(where)
                _copy_open(self._whole, where)
        except OSError as error:
            return f"and what came before is lost ({self._said(error)})"
        with suppress(OSError, RuntimeError, KeyError), _written(where, "r+") as file:
            file[self._run].attrs.modify(
                "why_incomplete", _of_fixed_length(f"recording stopped: {reason}")
            )
        return f"what came before is in {where}"

    def _is_ours(self, path: Path) -> bool:
        """Whether the visible file is still the one that was put there. FileNotFoundError where
        there is none.
        """
        return os.path.samestat(os.stat(path), os.fstat(self._whole))

    def _hold(self) -> None:
        """The visible file, also where somebody deletes it."""
        before, self._whole = self._whole, os.open(self.path, os.O_RDONLY | os.O_CLOEXEC)
        if before >= 0:
            os.close(before)

    def _said(self, error: Exception) -> str:
        """What went wrong, without the name of a file that nobody has asked for."""
        return str(error).replace(str(self._behind), str(self.path))


def record(
    writer: RunWriter,
    drain: Callable[[], Taken],
    wait: Callable[[], tuple[Sequence[Event], bool]],
    tell: Callable[[str | None, Sequence[str]], object] = lambda missing, news: None,
) -> str | None:
    """Write until `wait` says that it is over; `wait` lasts up to `INTERVAL_S` and returns the
    events of that time.

    `tell` hears what is missing so far, and what has happened to the files. Returns what is missing
    at the end. The first HapticError ends it, with what was written before still readable.
    """
    try:
        over = False
        while not over:
            events, over = wait()
            taken = drain()
            writer.append(Chunk(taken.samples, taken.lost, events))
            tell(writer.missing, writer.news())
        return writer.close()
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
        raise BadInputError(
            "bad_ending", f"{path}: a recording's name ends in .h5", "Give a name such as run.h5"
        )
    if not path.is_absolute():
        raise BadInputError(
            "relative_path", f"{path}: the daemon works in another folder", "Give an absolute path"
        )
    return path.resolve()


def hidden_copy(path: Path) -> Path:
    """The copy that is being written to."""
    return path.with_name(f".{path.name}.behind")


def left_by_dead(path: Path) -> str:
    """Where a recorder that died has left what came before, in words; of its hidden copy nothing
    stays.
    """
    try:
        if not path.exists():  # somebody has deleted it
            run_names(hidden_copy(path))
            os.link(hidden_copy(path), path)
        return f"what came before is in {path}"
    except (OSError, HapticError):
        return f"what came before is lost: somebody has deleted {path}"
    finally:
        remove_hidden(path)


def what_to_do(error: Exception) -> str:
    """A hint that fits what the system said."""
    number = error.errno if isinstance(error, OSError) else None
    if number in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG):
        return "Make room on the disk, or choose another one"
    if number in (errno.EACCES, errno.EPERM, errno.EROFS):
        return "Check the rights of the file and its folder, or choose another one"
    if number in (errno.ENOENT, errno.EEXIST, errno.ENOTDIR, errno.EISDIR):
        return (
            "Leave the file and its folder alone while they are recorded into, or choose"
            " another one"
        )
    return "Look at the disk, or choose a file on another one that is local"


def remove_hidden(path: Path) -> None:
    """Remove what a recorder of `path` leaves behind when it dies."""
    for left in (hidden_copy(path), _spare(hidden_copy(path))):
        with suppress(OSError):
            left.unlink(missing_ok=True)


def _spare(behind: Path) -> Path:
    return behind.with_name(f"{behind.name}.spare")


def _free_name(path: Path) -> Path:
    return next(
        there for n in count(2) if not (there := path.with_stem(f"{path.stem}-kept-{n}")).exists()
    )


def _copy_open(source: int, target: Path) -> None:
    """A new file with the content of an open one, which may have no name any more."""
    made = os.open(target, os.O_CREAT | os.O_EXCL | os.O_WRONLY, PRIVATE)
    with os.fdopen(os.dup(source), "rb") as content, os.fdopen(made, "wb") as file:
        content.seek(0)
        shutil.copyfileobj(content, file)
    os.chmod(target, os.fstat(source).st_mode)


def _copy(source: Path, target: Path) -> None:
    shutil.copyfile(source, target)
    os.chmod(target, source.stat().st_mode)


@contextmanager
def _written(path: Path, mode: str) -> Iterator[h5py.File]:
    """The open file; at the end of the block it is on the disk, or an OSError is raised."""
    with CheckedFile(path) as raw, h5py.File(raw, mode) as file:
        yield file


def _missing(path: Path, samples: int, events: int) -> str | None:
    said = [
        f"{number} {what}" for number, what in ((samples, "ticks"), (events, "events")) if number
    ]
    return (
        f"{' and '.join(said)} are missing in {path}: the recorder came too late for them"
        if said
        else None
    )


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
    group.create_dataset(
        name,
        (0,),
        kind,
        maxshape=(None,),
        chunks=(CHUNK_ROWS if name.startswith("samples") else 64,),
    )


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
