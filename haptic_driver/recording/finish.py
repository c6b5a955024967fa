"""From records to HDF5, as `read.py` describes it: when a run ends, and from what a crash has left.

A kill in the middle loses nothing. The HDF5 file is made under another name and takes its place as
a whole; only then do the records go. A run that is there already takes its own place.
"""

from __future__ import annotations

import io
import json
import logging
import os
import re
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from itertools import islice
from pathlib import Path
from typing import Annotated, Any

import h5py
import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from haptic_driver.config import Checked
from haptic_driver.errors import shown
from haptic_driver.processes.samples import SAMPLE
from haptic_driver.recording import records
from haptic_driver.recording.structure import FORMAT, FORMAT_VERSION, TABLES, plain_file

KIND = [list(field) for field in SAMPLE.descr]  # of ticks, as a header says it
CHUNK_ROWS = {"samples": 4096, "events": 64}
PIECES = 64  # blocks that go into HDF5 at a time

_log = logging.getLogger(__name__)


def finish(path: Path, descriptor: int) -> str | None:
    """Add the run of open records to the recording at `path`, or make it; what it lacks, in words.

    OSError, RuntimeError, ValueError for useless records, and BadInputError where `path` is
    something else. Then nothing has changed.
    """
    there = path.exists()
    if there:
        plain_file(path).close()
    with records.new_file(path, replace=there) as made:
        if there:
            with path.open("rb") as older:
                records.copy(older.fileno(), made)
        with CheckedFile(made, "r+b", closefd=False) as raw:
            try:
                with h5py.File(raw, "r+" if there else "w") as file:
                    lacks = _add_run(file, descriptor, path)
            finally:
                if raw.error is not None:
                    raise raw.error
    os.close(made)
    return lacks


@contextmanager
def opened(path: Path) -> Iterator[h5py.File]:
    """A recording, for reading. What a crash has left is put into it, which a log line says.

    A run that goes on is in it, in memory, as far as it is on the disk.
    """
    left, image = records.records_of(path), None
    with suppress(FileNotFoundError):
        if left.is_file():
            with left.open("rb") as held:
                if not _put_away(path, left, held.fileno()):
                    image = _in_memory(path, held.fileno())
    with plain_file(path) if image is None else h5py.File(image, "r") as file:
        yield file


def missing(path: Path, ticks: int, events: int, cause: str = "") -> str | None:
    """What a run lacks, in words; because of a late recorder where there is no other cause."""
    numbers = ((ticks, "ticks"), (events, "events"))
    said = " and ".join(f"{number} {what}" for number, what in numbers if number)
    why = cause or "the recorder came too late for them"
    return f"{said} are missing in {path}: {why}" if said else None


class CheckedFile(io.FileIO):
    """A file for h5py to write to, which keeps the first error: HDF5 prints it and goes on."""

    error: OSError | None = None

    def write(self, data: Any) -> int:
        left = memoryview(data).cast("B")
        try:
            records.write(self.fileno(), left, self.tell())  # HDF5 seeks before each
        except OSError as error:
            self.error = self.error or error
        return len(left)

    def truncate(self, size: int | None = None) -> int:
        try:
            return super().truncate(size)
        except OSError as error:
            self.error = self.error or error
            return 0


Count = Annotated[int, Field(ge=0, le=2**53)]  # that a double holds


class _Event(Checked):
    """A row of a run's events; `data` is JSON."""

    number: Count
    time_s: float
    kind: str
    message: str
    data: str


class _Block(Checked):
    """What a record says of its ticks: the number of the first, and the events meanwhile."""

    first: Count
    events: list[_Event]


class _Told:
    """What records say of a run beside its ticks and events, once all are read."""

    def __init__(self) -> None:
        self.header: dict[str, Any] = {}
        self.end: dict[str, Any] = {"why": "how it ended cannot be read", "count": 0}
        self.damage = ""
        self.ticks = self.lost = 0
        self.numbers: set[int] = set()

    def blocks(self, descriptor: int) -> Iterator[tuple[NDArray[np.void], list[dict[str, Any]]]]:
        """Ticks and events of each."""
        for record in records.records_in(descriptor):
            match record:
                case None:
                    self.damage = "its records are damaged"
                case {"why": _} as end, _:
                    self.end = end
                case {"run": _} as header, _:
                    self.header = header
                case {"first": _, "events": _} as said, data:
                    try:
                        block, samples = _Block.model_validate(said), np.frombuffer(data, SAMPLE)
                    except ValueError:  # ValidationError is one
                        self.damage = "its records are damaged"
                        continue
                    if block.first < self.ticks:
                        self.damage = "its records are damaged"
                    self.lost += max(block.first - self.ticks, 0)
                    self.ticks = block.first + samples.size
                    self.numbers |= {event.number for event in block.events}
                    yield samples, [event.model_dump() for event in block.events]
        self.lost += max(self.end["count"] - self.ticks, 0)

    @property
    def events_lost(self) -> int:
        """How many lie between the first and the last: they count up, though not in order."""
        numbers = self.numbers
        return max(numbers) - min(numbers) + 1 - len(numbers) if numbers else 0

    def lacks(self, path: Path) -> str | None:
        lost = missing(path, self.lost, self.events_lost, self.damage) or self.damage
        return "; ".join(filter(None, (self.end["why"], lost))) or None


def _add_run(file: h5py.File, descriptor: int, path: Path) -> str | None:
    told = _Told()
    blocks = told.blocks(descriptor)
    piece = list(islice(blocks, PIECES))
    if told.header.get("kind") != KIND:
        raise ValueError("the header of its records is damaged, or of another version")
    file.attrs["format"], file.attrs["format_version"] = FORMAT, FORMAT_VERSION
    said, name = told.header["attributes"], told.header["run"]
    if not re.fullmatch(r"run_[0-9]{4,9}", name):
        raise ValueError("the header of its records names no run")
    if name in file:
        if all(file[name].attrs[key] == said[key] for key in ("started_s", "started_at")):
            del file[name]  # put there by who was killed before the records were gone
        else:
            name = f"run_{len(file) + 1:04d}"
    group = file.create_group(name)
    config = json.dumps(told.header["config"])
    group.create_dataset("config", data=config, dtype=h5py.string_dtype())
    for table, kinds in TABLES.items():
        for column, kind in kinds.items():
            group.create_dataset(
                f"{table}/{column}", (0,), kind, maxshape=(None,), chunks=(CHUNK_ROWS[table],)
            )
    while piece:
        samples = np.concatenate([samples for samples, _ in piece])
        for column in TABLES["samples"]:
            _extend(group[f"samples/{column}"], samples[column])
        events = [event for _, some in piece for event in some]
        for column in TABLES["events"]:
            _extend(group[f"events/{column}"], [event[column] for event in events])
        piece = list(islice(blocks, PIECES))
    lacks = told.lacks(path)
    why = (lacks or "").encode("ascii", "replace")[: records.WHY_BYTES]
    group.attrs.update(said)
    group.attrs["samples_lost"] = float(told.lost)
    group.attrs["events_lost"] = float(told.events_lost)
    group.attrs["complete"] = float(lacks is None)
    group.attrs["why_incomplete"] = np.array(why, f"S{records.WHY_BYTES}")
    return lacks


def _extend(dataset: h5py.Dataset, values: Any) -> None:
    if len(values):
        before = dataset.shape[0]
        dataset.resize(before + len(values), axis=0)
        dataset[before:] = values


def _put_away(path: Path, left: Path, descriptor: int) -> bool:
    """Finish what a crash has left, where it is ours; whether it is in `path` now."""
    import fcntl  # noqa: PLC0415 - not on Windows

    said = f"{path}: a recorder was killed or had no space left, what it wrote is"
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        there = os.fstat(descriptor)
        if there.st_nlink and there.st_uid == os.geteuid():
            finish(path, descriptor)
            records.remove(left, descriptor)
            _log.warning(shown(f"{said} in it now"))
            return True
        return not there.st_nlink  # another reader was first
    except BlockingIOError:  # it is being recorded
        return False
    except OSError as error:
        _log.warning(shown(f"{said} still in {left} ({error})"))
        return False


def _in_memory(path: Path, descriptor: int) -> io.BytesIO:
    there = path.exists()
    if there:
        plain_file(path).close()
    image = io.BytesIO(path.read_bytes() if there else b"")
    with h5py.File(image, "r+" if there else "w") as file:
        _add_run(file, descriptor, path)
    return image
