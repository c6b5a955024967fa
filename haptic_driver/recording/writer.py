"""The recorder adds records to a file while a run goes on (`records.py`), and makes HDF5 of them
when the run ends (`finish.py`).

The records are readable up to the last that was forced to the disk, whenever the recorder dies and
however full the disk gets. The recording itself, with the runs that were in it, is not touched. Who
deletes one of the two files meanwhile loses nothing: each is put back from its descriptor. A run of
which ticks or events are missing never says that it is complete.
"""

from __future__ import annotations

import datetime
import errno
import json
import math
import os
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from haptic_driver.errors import BadInputError, HapticError
from haptic_driver.files import require_ending
from haptic_driver.processes.shared_memory import Taken
from haptic_driver.recording import records
from haptic_driver.recording.clock import ClockOffsets, clock_offsets
from haptic_driver.recording.event import Event
from haptic_driver.recording.finish import KIND, finish, missing
from haptic_driver.recording.read import run_names

INTERVAL_S = 0.5  # between records; what a crash may cost
FAILURES = (OSError, RuntimeError, ValueError, KeyError, HapticError)  # of making HDF5


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

    def attributes(self) -> dict[str, str | float]:
        """As they stand in the file."""
        found = {
            name: json.dumps(value) if isinstance(value, dict) else value
            for name, value in vars(self).items()
            if name not in ("config", "clock")
        }
        offsets_s = {name: math.nan if s is None else s for name, s in self.clock}
        return found | offsets_s | {"simulated": float(self.simulated)}


@dataclass(frozen=True)
class Chunk:
    """What came since the last time: samples of dtype SAMPLE, how many are missing before them, and
    events.
    """

    samples: NDArray[np.void]
    lost: int
    events: Sequence[Event]


class RunWriter:
    """One new run at the end of a recording, which is made, private, where there is none.

    Raises BadInputError for a path that cannot be used, HapticError `recording_failed` when writing
    fails; what was written before is readable whatever happens.
    """

    def __init__(self, path: Path, header: RunHeader) -> None:
        self.path = where(path)
        self.samples = 0
        self.lost = 0
        self._news: list[str] = []
        self._left = left = records.records_of(self.path)
        is_new = not (self.path.exists() or left.exists())
        number = 1 if is_new else len(run_names(self.path)) + 1  # what a crash has left is put away
        told = {"run": f"run_{number:04d}", "kind": KIND, "config": header.config}
        try:
            with records.new_file(left) as made:
                records.say(made, records.NOT_ENDED, 0)
                for _ in range(2):
                    records.add(made, told | {"attributes": header.attributes()})
            self._held = {left: made}
            if self.path.exists():
                self._held[self.path] = os.open(self.path, os.O_RDONLY | os.O_CLOEXEC)
        except (OSError, records.TooLongError) as error:
            said = f"{path}: cannot be written ({error})"
            raise BadInputError("recording_not_made", said, what_to_do(error)) from error

    def append(self, chunk: Chunk) -> None:
        """Write one more piece through to the disk."""
        count = self.samples + self.lost
        events = [event.model_dump() | {"data": json.dumps(event.data)} for event in chunk.events]
        try:
            self._put_back()
            self._add(count + chunk.lost, chunk.samples, events)
        except OSError as error:
            with suppress(OSError):
                records.say(self._held[self._left], f"recording stopped: {error}", count)
            with suppress(*FAILURES):
                self._finish()
            raise self._failed("recording stopped", error) from error
        self.samples += len(chunk.samples)
        self.lost += chunk.lost

    def _add(self, first: int, samples: NDArray[np.void], events: list[dict[str, Any]]) -> None:
        """As one record, or as more where one would be too long. The first half has all ticks,
        or half of them where there is no event.
        """
        told = {"first": first, "events": events}
        try:
            records.add(self._held[self._left], told, samples.tobytes())
        except records.TooLongError:
            half, some = len(samples) // 2 if not events else len(samples), len(events) // 2
            if half == 0 and some == 0:
                raise
            self._add(first, samples[:half], events[:some])
            self._add(first + half, samples[half:], events[some:])

    def close(self) -> str | None:
        """Make HDF5 of the run, marked as complete or as what it lacks; that, in words."""
        try:
            self._put_back()
            records.say(self._held[self._left], "", self.samples + self.lost)
            return self._finish()
        except FAILURES as error:
            raise self._failed("cannot be written", error) from error

    @property
    def missing(self) -> str | None:
        """Which ticks the run lacks so far, in words; None where none is missing. Events may come
        late.
        """
        return missing(self.path, self.lost, 0)

    def news(self) -> list[str]:
        """What has happened to its files since the last time, in words."""
        said, self._news = self._news, []
        return said

    def _put_back(self) -> None:
        for path, held in self._held.items():
            if not os.fstat(held).st_nlink:
                with records.new_file(path) as made:
                    records.copy(held, made)
                os.close(held)
                self._held[path] = made
                said = "was deleted while it is recorded, and is put back, whole"
                self._news.append(f"{path} {said}")

    def _finish(self) -> str | None:
        lacks = finish(self.path, self._held[self._left])
        records.remove(self._left, self._held[self._left])
        self._let_go()
        return lacks

    def _failed(self, what: str, error: Exception) -> HapticError:
        self._let_go()
        said = f"{self.path}: {what} ({error}), {left_in(self.path)}"
        return HapticError("recording_failed", said, what_to_do(error))

    def _let_go(self) -> None:
        while self._held:
            os.close(self._held.popitem()[1])


def record(
    writer: RunWriter,
    drain: Callable[[], Sequence[Taken]],
    wait: Callable[[], tuple[Sequence[Event], bool]],
    tell: Callable[[str | None, Sequence[str]], object] = lambda missing, news: None,
) -> str | None:
    """Write until `wait` says that it is over; `wait` lasts up to `INTERVAL_S` and returns the
    events of that time.

    `tell` hears what is missing so far, and what has happened to the files. Returns what is missing
    at the end. The first HapticError ends it, with what was written before still readable.
    """
    over = False
    while not over:
        events, over = wait()
        for taken in drain():
            writer.append(Chunk(taken.samples, taken.lost, events))
            events = ()
        tell(writer.missing, writer.news())
    return writer.close()


def where(path: Path) -> Path:
    """Where to record: absolute, ending in .h5 or .hdf5. BadInputError otherwise."""
    require_ending(path, [".h5", ".hdf5"])
    if not path.is_absolute():
        raise BadInputError(
            "relative_path", f"{path}: the daemon works in another folder", "Give an absolute path"
        )
    return path.resolve()


def left_in(path: Path) -> str:
    """Where what a recorder of `path` has left is, in words."""
    left = records.records_of(path)
    if left.exists():
        return f"what came before is in {left}, of which `haptic export {path}` makes HDF5"
    return f"nothing is left in {left}: look at {path}"


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
