"""Tables of columns, written in blocks: CSV and Parquet."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from haptic_driver.errors import BadInputError, optional
from haptic_driver.files import exists_already
from model.support.cells import written_cells

Blocks = Iterator[list[NDArray[Any]]]
"""Columns of some rows at a time, at least once."""

Writer = Callable[[Path, Sequence[str], Blocks, dict[str, Any]], None]


def writer_of(out: Path, force: bool) -> Writer:
    """What writes a table of the kind that the ending of `out` says.

    BadInputError for an unknown ending, and a file that exists, unless `force`.
    """
    write = {".csv": write_csv, ".parquet": write_parquet}.get(out.suffix.lower())
    if write is None:
        raise BadInputError(
            "bad_ending", f"{out}: ends neither in .csv nor in .parquet", "Give --out run.csv"
        )
    if out.exists() and not force:
        raise exists_already(out)
    return write


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
