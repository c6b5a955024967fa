"""Recordings and other columns as tables, written in blocks: CSV, Parquet and MAT."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from haptic_driver.errors import optional
from haptic_driver.files import replacing, require_ending, require_free
from haptic_driver.recording.read import attributes_of, column_of, name_of, runs_of
from haptic_driver.recording.structure import EVENT_FIELDS, FIELDS
from model.support.cells import written_cells

BLOCK_ROWS = 1 << 15  # exported at a time
# beside the columns of a run: its number, its time from its beginning, seconds of UTC since 1970
TOLD_FIELDS = ("run", "run_time_s", "wall_time_s")

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
    with runs_of(path, run, every) as groups:
        table = "events" if events else "samples"
        fields = tuple(EVENT_FIELDS) if events else FIELDS
        about = [{"run": name_of(group), **attributes_of(group)} for group in groups]
        said = {"recording": path.name} | ({"runs": about} if every else about[0])
        with replacing(out) as part:
            blocks = _blocks(groups, table, fields, progress)
            write(part, (*fields, *TOLD_FIELDS), blocks, said)
        return sum(_rows(group, table) for group in groups)


def row_count(
    path: Path, run: str | None = None, *, every: bool = False, events: bool = False
) -> int:
    """Samples (or events) in a run, or in `every` run."""
    with runs_of(path, run, every) as groups:
        return sum(_rows(group, "events" if events else "samples") for group in groups)


def _rows(group: h5py.Group, table: str) -> int:
    return int(group[f"{table}/time_s"].shape[0])


def _blocks(
    groups: Sequence[h5py.Group], name: str, fields: Sequence[str], progress: Callable[[int], None]
) -> Blocks:
    """Columns of a table of all runs, some rows at a time, at least once."""
    done = 0
    for group in groups:
        table, said = group[name], attributes_of(group)
        number = int(name_of(group).rpartition("_")[2])
        count = _rows(group, name)
        for start in range(0, max(count, 1), BLOCK_ROWS):
            rows = slice(start, min(start + BLOCK_ROWS, count))
            columns = [column_of(table, field, rows) for field in fields]
            time_s = columns[fields.index("time_s")]
            of_run_s = time_s - said["started_s"]
            wall_s = time_s + said.get("wall_offset_s", np.nan)
            yield [*columns, np.full(time_s.size, number), of_run_s, wall_s]
            progress(done + rows.stop)
        done += count
