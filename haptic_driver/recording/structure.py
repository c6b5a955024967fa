"""What a run must look like before it is read: plain data in the file itself, no larger than the
file.

A recording may come from anybody. HDF5 lets a dataset lie in another file, a link lead anywhere,
and a shape of a few bytes stand for terabytes.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from haptic_driver.errors import BadInputError
from haptic_driver.processes.samples import ADDED, SAMPLE

FORMAT = "haptic-driver recording"
FORMAT_VERSION = 1.0
FIELDS: tuple[str, ...] = SAMPLE.names or ()
EVENT_FIELDS = {
    "number": "u8",
    "time_s": "f8",
    "kind": h5py.string_dtype(),
    "message": h5py.string_dtype(),
    "data": h5py.string_dtype(),
}
TABLES = {"samples": {name: SAMPLE[name] for name in FIELDS}, "events": EVENT_FIELDS}
TEXT_ROWS = 16  # read at a time: each may be as long as the file


def plain_file(path: Path) -> h5py.File:
    """A recording, open for reading, as it lies on the disk. BadInputError where it is none."""
    if not os.path.isfile(path):
        said = (
            "is a folder, not a recording" if os.path.isdir(path) else "there is no such recording"
        )
        raise BadInputError("recording_not_found", f"{path}: {said}", "Check the path")
    try:
        file = h5py.File(path, "r", locking=False)
    except OSError as error:
        said = f"{path}: not a readable HDF5 file ({error})"
        raise BadInputError(
            "recording_unreadable", said, "Give a file that haptic record wrote"
        ) from error
    try:
        _check_format(path, file)
    except BaseException:
        file.close()
        raise
    return file


def _check_format(path: Path, file: h5py.File) -> None:
    if file.attrs.get("format") != FORMAT:
        said = f"{path}: is HDF5 but not a recording"
        raise BadInputError("recording_foreign", said, "Give a file that haptic record wrote")
    version = float(file.attrs["format_version"])
    if version != FORMAT_VERSION:
        said = f"{path}: has format {version:g}, this program reads {FORMAT_VERSION:g}"
        raise BadInputError(
            "recording_version",
            said,
            "Use the version of haptic-driver that wrote it, or a newer one",
        )


def member(parent: h5py.Group, name: str, kind: type) -> Any:
    """A group or dataset of `parent` that is really there. Raises ValueError otherwise."""
    where = f"{parent.name.rstrip('/')}/{name}"
    link = parent.get(name, getlink=True)
    if link is None:
        raise ValueError(f"{where} is missing")
    if not isinstance(link, h5py.HardLink):
        raise ValueError(f"{where} is a link to elsewhere, which is not followed")
    found = parent[name]
    if not isinstance(found, kind):
        raise ValueError(f"{where} is no {kind.__name__.lower()}")
    return found


def check_run(run: h5py.Group, tables: Mapping[str, Mapping[str, Any]], file_bytes: int) -> None:
    """ValueError unless each table has its columns, with the types given, of one length, and all
    fit into the file. Columns that recordings had not from the first may be missing.
    """
    check_plain(member(run, "config", h5py.Dataset), h5py.string_dtype(), 0)
    total = 0
    for table, kinds in tables.items():
        group = member(run, table, h5py.Group)
        there = [name for name in kinds if name not in ADDED or name in group]
        columns = [member(group, name, h5py.Dataset) for name in there]
        for name, column in zip(there, columns, strict=True):
            check_plain(column, np.dtype(kinds[name]), 1)
            total += column.size * column.dtype.itemsize
        if len({column.size for column in columns}) > 1:
            raise ValueError(f"{group.name}: columns differ in length")
    if total > file_bytes:
        raise ValueError(f"{run.name} claims {total} bytes in a file of {file_bytes}")


def read_column(column: h5py.Dataset, rows: slice, file_bytes: int) -> NDArray[Any]:
    """Some rows of a checked column. ValueError where they cannot be read, or are more text than
    the file can hold.
    """
    try:
        if h5py.check_string_dtype(column.dtype) is None:
            plain: NDArray[Any] = column[rows]
            return plain
        text = column.asstr()
        found: list[str] = []
        length = 0
        start, stop, _ = rows.indices(column.size)
        for first in range(start, stop, TEXT_ROWS):
            found += text[first : min(first + TEXT_ROWS, stop)].tolist()
            length += sum(map(len, found[first - start :]))
            if length > file_bytes:
                raise ValueError(f"{column.name} holds more text than the file")
        return np.array(found, object)
    except OSError as error:
        raise ValueError(f"{column.name}: {error}") from error


def check_plain(dataset: h5py.Dataset, kind: np.dtype[Any], dimensions: int) -> None:
    is_text = h5py.check_string_dtype(kind) is not None
    is_as_said = (
        h5py.check_string_dtype(dataset.dtype) is not None if is_text else dataset.dtype == kind
    )
    if not is_as_said or dataset.shape is None or len(dataset.shape) != dimensions:
        raise ValueError(
            f"{dataset.name} is not as a recording has it (shape {dataset.shape}, {dataset.dtype})"
        )
    if dataset.is_virtual or dataset.external:
        raise ValueError(f"{dataset.name} lies in another file, which is not read")
    if dataset.id.get_create_plist().get_nfilters():
        raise ValueError(f"{dataset.name} is packed: unpack it with h5repack -f NONE")
