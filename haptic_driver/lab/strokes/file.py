"""Every stroke of a measured experiment: HDF5 beside its data file, `data.strokes.h5`.

- `/rows/NAME`: one entry per stroke, for the names of `ROW_FIELDS`. `row` is the line of the data
  file below its header, from 1; the setting is as it was commanded. `steady_begin_m` and
  `steady_end_m` bound the steady window by displacement. `first_sample` counts from 0.
- `/samples/NAME`: one entry per reading of the force sensor, for the names of `SAMPLE_FIELDS`.
  `displacement_m` is 0 where the voltage is up and friction begins to settle; `position_m` is the
  stage's. `time_s` is that of the data file. `monitor_voltage_v` and `monitor_current_a` are the
  amplifier's monitors, peak, NaN where none is wired. `steady` is 1 within the window.
- attributes, strings or floats: `format`, `format_version`, `plan`, `model`, `rig`, `simulated`.

While rows are measured they are records beside it (`records.py`), so that a kill costs no stroke
that was whole. They are read as the file is, and become HDF5 when measuring ends, or goes on.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple, Self

import h5py
import numpy as np
from numpy.typing import NDArray

from haptic_driver.errors import BadInputError
from haptic_driver.files import replacing, writing
from haptic_driver.lab.tables import Blocks, writer_of
from haptic_driver.lookup import labelled
from haptic_driver.recording import records
from haptic_driver.recording.finish import CheckedFile
from haptic_driver.recording.structure import check_plain, member, read_column

FORMAT = "haptic-driver strokes"
FORMAT_VERSION = 1.0
ENDING = ".strokes.h5"
SAMPLE = np.dtype(
    [
        ("time_s", "f8"),
        ("displacement_m", "f8"),
        ("position_m", "f8"),
        ("velocity_m_s", "f8"),
        ("lateral_force_n", "f8"),
        ("normal_force_n", "f8"),
        ("monitor_voltage_v", "f8"),
        ("monitor_current_a", "f8"),
        ("steady", "u1"),
    ]
)
SAMPLE_FIELDS: tuple[str, ...] = SAMPLE.names or ()
ROW_FIELDS: dict[str, Any] = {
    "row": "i8",
    "session": "i8",
    "trial": "i8",
    "frequency_hz": "f8",
    "voltage_v": "f8",
    "commanded_normal_force_n": "f8",
    "speed_m_s": "f8",
    "voltage_offset_v": "f8",
    "waveform": h5py.string_dtype(),
    "steady_begin_m": "f8",
    "steady_end_m": "f8",
    "first_sample": "i8",
    "samples": "i8",
}


class StrokeRow(NamedTuple):
    """Which row a stroke is of, what was commanded, and its steady window by displacement."""

    row: int
    session: int
    trial: int
    frequency_hz: float
    voltage_v: float
    commanded_normal_force_n: float
    speed_m_s: float
    voltage_offset_v: float
    waveform: str
    steady_begin_m: float
    steady_end_m: float


@dataclass(frozen=True)
class KeptStroke:
    """One stroke; `samples` [n] of dtype SAMPLE."""

    row: StrokeRow
    samples: NDArray[np.void]


@dataclass(frozen=True)
class KeptStrokes:
    """All strokes of a file by their rows, and its attributes."""

    about: dict[str, Any]
    strokes: tuple[KeptStroke, ...]

    def to_frame(self) -> Any:
        """A pandas DataFrame, one line per sample; HapticError where pandas is not installed."""
        columns = dict(zip(TABLE_FIELDS, _table(self.strokes), strict=True))
        return labelled.frame(columns, self.about)


TABLE_FIELDS = (*StrokeRow._fields[:-2], *SAMPLE_FIELDS)
"""Columns of the table that a file is exported as: what is said of a stroke stands in each line."""


def strokes_path(data: Path) -> Path:
    """Where the strokes of a data file lie."""
    return data.with_suffix(ENDING)


class StrokesFile:
    """The strokes of an experiment that is being measured. Use as a context manager: HDF5 is made
    at its end, however that comes.
    """

    def __init__(self, path: Path, descriptor: int) -> None:
        self._path = path
        self._left = records.records_of(path)
        self._descriptor = descriptor

    @classmethod
    def create(cls, path: Path, about: Mapping[str, str | float]) -> Self:
        """A new one, whatever is there."""
        with writing(path):
            path.unlink(missing_ok=True)
            records.records_of(path).unlink(missing_ok=True)
        return cls._begin(path, about)

    @classmethod
    def resume(cls, path: Path, about: Mapping[str, str | float]) -> Self:
        """Go on with what is there. A row that is measured again replaces its stroke."""
        if records.records_of(path).exists():
            _put_away(path)
        if path.exists():
            read_strokes(path)  # is one
        return cls._begin(path, about)

    @classmethod
    def _begin(cls, path: Path, about: Mapping[str, str | float]) -> Self:
        with writing(path), records.new_file(records.records_of(path)) as made:
            records.add(made, {"format": FORMAT, "about": dict(about)})
        return cls(path, made)

    def append(self, stroke: KeptStroke) -> None:
        """Write a stroke through to the disk."""
        with writing(self._path):
            records.add(self._descriptor, stroke.row._asdict(), stroke.samples.tobytes())

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        """Make HDF5 of it; what cannot be made stays as records."""
        try:
            _finish(self._path, self._left, self._descriptor)
        finally:
            os.close(self._descriptor)


def require_free(path: Path, *, force: bool) -> None:
    """BadInputError where strokes lie already, unless `force`."""
    if (path.exists() or records.records_of(path).exists()) and not force:
        said = f"{path}: exists already, though the data file that it belongs to does not"
        raise BadInputError("file_exists", said, "Give --force or another --out")


def is_strokes(path: Path) -> bool:
    """Whether a file says that it holds strokes, or records beside it do."""
    with suppress(OSError), h5py.File(path, "r", locking=False) as file:
        return bool(file.attrs.get("format") == FORMAT)
    return not path.exists() and _begun(records.records_of(path))


def read_strokes(path: Path) -> KeptStrokes:
    """The strokes of a file, with those that are being measured or that a kill has left as records.

    BadInputError for a missing, damaged, foreign or newer file.
    """
    left = records.records_of(path)
    if not path.exists() and not left.exists():
        raise BadInputError(
            "no_strokes",
            f"{path}: there is no such file of strokes",
            "haptic measure writes it beside its data file; give that data file, or measure anew",
        )
    try:
        about, found = _from_hdf5(path) if path.exists() else ({}, {})
        if left.exists():
            with left.open("rb") as held:
                begun, more = _from_records(held.fileno())
            about, found = about | begun, found | more
    except BadInputError:
        raise
    except (OSError, KeyError, ValueError, RuntimeError, TypeError) as error:
        said = f"{path}: is no file of strokes, or damaged ({error})"
        raise BadInputError("strokes_unreadable", said, "Give a file of haptic measure") from error
    return KeptStrokes(about, tuple(found[row] for row in sorted(found)))


def export_strokes(
    path: Path,
    out: Path,
    *,
    force: bool = False,
    progress: Callable[[int], None] = lambda rows: None,
) -> int:
    """Write every sample with its stroke's setting as a table, .csv or .parquet by the ending of
    `out`; returns its rows. Raises as `read_strokes`, and for `out` as `writer_of`.
    """
    write = writer_of(out, force)
    found = read_strokes(path)
    with replacing(out) as part:
        write(part, TABLE_FIELDS, _blocks(found.strokes, progress), found.about)
    return sum(stroke.samples.size for stroke in found.strokes)


def sample_count(path: Path) -> int:
    """Samples of all strokes."""
    return sum(stroke.samples.size for stroke in read_strokes(path).strokes)


def _blocks(strokes: Sequence[KeptStroke], progress: Callable[[int], None]) -> Blocks:
    done = 0
    if not strokes:
        yield _table(strokes)
    for stroke in strokes:
        yield _table([stroke])
        done += stroke.samples.size
        progress(done)


def _table(strokes: Sequence[KeptStroke]) -> list[NDArray[Any]]:
    sizes = [stroke.samples.size for stroke in strokes]
    said = [np.repeat(_row_column(strokes, name), sizes) for name in StrokeRow._fields[:-2]]
    samples = _joined(strokes)
    return said + [samples[name] for name in SAMPLE_FIELDS]


def _row_column(strokes: Sequence[KeptStroke], name: str) -> NDArray[Any]:
    kind = ROW_FIELDS[name]
    is_text = h5py.check_string_dtype(np.dtype(kind)) is not None
    return np.array([getattr(stroke.row, name) for stroke in strokes], object if is_text else kind)


def _joined(strokes: Sequence[KeptStroke]) -> NDArray[np.void]:
    return np.concatenate([np.empty(0, SAMPLE), *(stroke.samples for stroke in strokes)])


Found = tuple[dict[str, Any], dict[int, KeptStroke]]


def _from_records(descriptor: int) -> Found:
    """What is whole in records; of a row that was measured again, the last."""
    about: dict[str, Any] = {}
    found: dict[int, KeptStroke] = {}
    for record in records.records_in(descriptor):
        match record:
            case None:
                continue
            case {"about": said}, _:
                about = dict(said)
            case said, data:
                row = StrokeRow(**said)
                found[row.row] = KeptStroke(row, np.frombuffer(data, SAMPLE))
    return about, found


def _begun(left: Path) -> bool:
    with suppress(OSError, ValueError), left.open("rb") as held:
        first = next(iter(records.records_in(held.fileno())), None)
        return first is not None and first[0].get("format") == FORMAT
    return False


def _from_hdf5(path: Path) -> Found:
    with h5py.File(path, "r", locking=False) as file:
        if file.attrs.get("format") != FORMAT:
            said = f"{path}: is HDF5 but holds no strokes"
            raise BadInputError("strokes_foreign", said, "Give a file that haptic measure wrote")
        version = float(file.attrs["format_version"])
        if version != FORMAT_VERSION:
            said = f"{path}: has format {version:g}, this program reads {FORMAT_VERSION:g}"
            raise BadInputError("strokes_version", said, "Use the version that wrote it")
        bytes_ = file.id.get_filesize()
        rows = _columns(file, "rows", ROW_FIELDS, bytes_)
        columns = _columns(file, "samples", {name: SAMPLE[name] for name in SAMPLE_FIELDS}, bytes_)
        about = {name: _plain(value) for name, value in file.attrs.items()}
    samples = np.empty(columns["time_s"].size, SAMPLE)
    for name in SAMPLE_FIELDS:
        samples[name] = columns[name]
    return about, dict(_split(rows, samples))


def _split(rows: Mapping[str, Any], samples: NDArray[np.void]) -> Iterator[tuple[int, KeptStroke]]:
    lists = [rows[name].tolist() for name in StrokeRow._fields]
    first, count = rows["first_sample"].tolist(), rows["samples"].tolist()
    for i, said in enumerate(zip(*lists, strict=True)):
        if not 0 <= first[i] <= first[i] + count[i] <= samples.size:
            raise ValueError(f"row {said[0]} claims samples that are not there")
        row = StrokeRow(*said)
        yield row.row, KeptStroke(row, samples[first[i] : first[i] + count[i]])


def _columns(file: h5py.File, table: str, kinds: Mapping[str, Any], bytes_: int) -> dict[str, Any]:
    """Columns of a table that are of one length and fit into the file; ValueError otherwise."""
    group = member(file, table, h5py.Group)
    sets = {name: member(group, name, h5py.Dataset) for name in kinds}
    for name, kind in kinds.items():
        check_plain(sets[name], np.dtype(kind), 1)
    if len({column.size for column in sets.values()}) > 1:
        raise ValueError(f"columns of {table} differ in length")
    if sum(column.size * column.dtype.itemsize for column in sets.values()) > bytes_:
        raise ValueError(f"{table} claims more than the file holds")
    return {name: read_column(column, slice(None), bytes_) for name, column in sets.items()}


def _plain(value: Any) -> str | float:
    return value if isinstance(value, str) else float(value)


def _put_away(path: Path) -> None:
    """Make HDF5 of the records that a kill has left."""
    left = records.records_of(path)
    with writing(path):
        held = os.open(left, os.O_RDONLY | os.O_CLOEXEC)
    try:
        if _begun(left):
            _finish(path, left, held)
        else:
            said = f"{left}: holds no strokes"
            raise BadInputError("strokes_unreadable", said, "Move it away, then go on")
    finally:
        os.close(held)


def _finish(path: Path, left: Path, descriptor: int) -> None:
    """Records and what is at `path` already become its HDF5; only then do the records go."""
    about, found = _from_records(descriptor)
    if path.exists():
        found = _from_hdf5(path)[1] | found
    strokes = [found[row] for row in sorted(found)]
    with replacing(path) as part:
        part.touch()
        with CheckedFile(str(part), "r+b") as raw:
            try:
                with h5py.File(raw, "w") as file:
                    _write(file, about, strokes)
            finally:
                if raw.error is not None:
                    raise raw.error
            os.fsync(raw.fileno())
    records.remove(left, descriptor)


def _write(
    file: h5py.File, about: Mapping[str, str | float], strokes: Sequence[KeptStroke]
) -> None:
    file.attrs.update({**about, "format": FORMAT, "format_version": FORMAT_VERSION})
    counts = np.array([stroke.samples.size for stroke in strokes], "i8")
    told = {name: _row_column(strokes, name) for name in StrokeRow._fields}
    told |= {"first_sample": np.cumsum(counts) - counts, "samples": counts}
    for name, kind in ROW_FIELDS.items():
        file.create_dataset(f"rows/{name}", data=told[name], dtype=kind)
    samples = _joined(strokes)
    for name in SAMPLE_FIELDS:
        file.create_dataset(f"samples/{name}", data=samples[name])
