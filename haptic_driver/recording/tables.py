"""Tables of columns, written in blocks: CSV, Parquet and MAT."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from haptic_driver.errors import optional
from haptic_driver.files import require_ending, require_free
from model.support.cells import written_cells

Blocks = Iterator[list[NDArray[Any]]]
"""Columns of some rows at a time, at least once."""

Writer = Callable[[Path, Sequence[str], Blocks, dict[str, Any]], None]


def writer_of(out: Path, force: bool) -> Writer:
    """What writes a table of the kind that the ending of `out` says.

    BadInputError for an unknown ending, and a file that exists, unless `force`.
    """
    known = {".csv": write_csv, ".parquet": write_parquet, ".mat": write_mat}
    require_ending(out, known)
    require_free(out, force)
    return known[out.suffix.lower()]


def write_csv(path: Path, fields: Sequence[str], blocks: Blocks, about: dict[str, Any]) -> None:
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(fields)
        for columns in blocks:
            writer.writerows(zip(*(_cells(column) for column in columns), strict=True))


def _cells(column: NDArray[Any]) -> list[Any]:
    cells: list[Any] = column.tolist()
    if column.dtype.kind == "O":
        return written_cells(cells)
    return ["" if cell != cell else cell for cell in cells] if column.dtype.kind == "f" else cells  # noqa: PLR0124 - NaN


def write_parquet(path: Path, fields: Sequence[str], blocks: Blocks, about: dict[str, Any]) -> None:
    """With `about` as JSON under the key `haptic_driver` of the file's metadata."""
    pa, parquet = (
        optional(module, "parquet", "Parquet") for module in ("pyarrow", "pyarrow.parquet")
    )
    first = next(blocks)
    metadata = {"haptic_driver": json.dumps(about)}
    schema = pa.table(dict(zip(fields, first, strict=True))).schema.with_metadata(metadata)
    with parquet.ParquetWriter(path, schema) as writer:
        writer.write_table(pa.table(dict(zip(fields, first, strict=True)), schema=schema))
        for columns in blocks:
            writer.write_table(pa.table(dict(zip(fields, columns, strict=True)), schema=schema))


def write_mat(path: Path, fields: Sequence[str], blocks: Blocks, about: dict[str, Any]) -> None:
    """A variable for each column, and `about` as JSON; format 5, texts as cells."""
    from scipy.io import savemat  # noqa: PLC0415  (slow to import)

    parts = list(blocks)
    columns = {name: np.concatenate([part[i] for part in parts]) for i, name in enumerate(fields)}
    with path.open("wb") as file:
        savemat(file, columns | {"about": json.dumps(about)}, oned_as="column")
