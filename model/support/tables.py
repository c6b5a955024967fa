"""Tables that a user gives as CSV: named columns, one header line; ModelError says file, line and
column.
"""

from __future__ import annotations

import csv
import hashlib
import io
import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from model.support.cells import read_cell
from model.support.errors import ModelError
from model.support.reading import LARGEST_FILE_BYTES, as_text, read_bytes

ROW_BYTES = 100  # where rows are limited
MOST_SAID = 40  # columns that an error names
COMMAS = "Save it with commas between the columns and points in the numbers: 0.5, not 0,5"


@dataclass(frozen=True)
class Table:
    """The cells of a file as text, without the spaces around them: each of `rows` by column,
    `lines` where it stands.

    A row that ends early has empty cells; empty rows, lines that begin with #, and empty columns
    without a name at the end are left out. `wanted` is the hint that says what the file must look
    like; `content_hash` the SHA-256 of the file.
    """

    path: Path
    columns: list[str]
    rows: list[dict[str, str]]
    lines: list[int]
    wanted: str
    content_hash: str

    def require(self, column: str) -> None:
        """ModelError where there is no such column."""
        _require(self.path, self.columns, column, self.wanted)

    def text(self, column: str) -> list[str]:
        """One column as it is written."""
        return [row[column] for row in self.rows]

    def number(self, row: int, column: str) -> float:
        """One cell; ModelError where it is no finite number."""
        text = self.rows[row][column]
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            said = f"{self.where(row)}: {column} is {text!r}, not a number"
            hint = f"Write a plain number in SI units there, such as 0.5. {self.wanted}"
            raise ModelError(said, hint, "not_a_number")
        return value

    def numbers(
        self,
        column: str,
        where_empty: float | None = None,
        ignored: NDArray[np.bool_] | None = None,
    ) -> NDArray[np.float64]:
        """One column [n]: `where_empty` in empty cells, if given, and 0 in the rows `ignored`,
        whatever they say.
        """
        values = np.zeros(len(self.rows))
        for i, text in enumerate(self.text(column)):
            if ignored is not None and ignored[i]:
                continue
            values[i] = self.number(i, column) if text or where_empty is None else where_empty
        return values

    def where(self, row: int) -> str:
        """File and line of a row."""
        return f"{self.path}, line {self.lines[row]}"


def read_table(
    path: Path, required: Sequence[str], wanted: str, most_rows: int | None = None
) -> Table:
    """A table with the columns `required`; `wanted` is the hint that says what the file must look
    like.
    """
    try:
        content = read_bytes(
            path, LARGEST_FILE_BYTES if most_rows is None else most_rows * ROW_BYTES
        )
        text = as_text(path, content)
    except ModelError as error:
        raise ModelError(error.message, f"{error.hint}. {wanted}", error.code) from None
    reader = csv.reader(io.StringIO(text, newline=""))
    try:
        read = islice(reader, most_rows)
        numbered = [
            (reader.line_num, [read_cell(cell.strip()) for cell in cells]) for cells in read
        ]
        is_whole = next(reader, None) is None
    except csv.Error as error:
        raise ModelError(
            f"{path}, line {reader.line_num}: is not CSV ({error})", wanted, "bad_table"
        ) from None
    if not is_whole:
        raise ModelError(
            f"{path}: has more than {most_rows} rows",
            f"Leave some out. {wanted}",
            "table_too_large",
        )
    numbered = [
        (line, cells) for line, cells in numbered if any(cells) and not cells[0].startswith("#")
    ]
    columns = _without_empty_end(numbered[0][1]) if numbered else []
    _check_columns(path, columns, required, wanted)
    rows = [_row(f"{path}, line {line}", columns, cells) for line, cells in numbered[1:]]
    lines = [line for line, _ in numbered[1:]]
    return Table(path, columns, rows, lines, wanted, hashlib.sha256(content).hexdigest())


def _without_empty_end(cells: list[str]) -> list[str]:
    """Cells up to the last that says something: spreadsheets leave commas behind."""
    last = next((i for i in range(len(cells), 0, -1) if cells[i - 1]), 0)
    return cells[:last]


def _check_columns(path: Path, columns: list[str], required: Sequence[str], wanted: str) -> None:
    for separator, name in ((";", "semicolons"), ("\t", "tabs")):
        if len(columns) == 1 and separator in columns[0]:
            raise ModelError(
                f"{path}: its columns are separated by {name}", f"{COMMAS}. {wanted}", "bad_table"
            )
    for column in required:
        _require(path, columns, column, wanted)
    for column, times in Counter(columns).items():
        if times > 1:
            raise ModelError(
                f"{path}: column {column!r} stands more than once", "Keep one of them", "bad_table"
            )


def _require(path: Path, columns: list[str], column: str, wanted: str) -> None:
    if column not in columns:
        more = f", and {len(columns) - MOST_SAID} more" if len(columns) > MOST_SAID else ""
        found = (
            f"; found: {', '.join(columns[:MOST_SAID])}{more}"
            if columns
            else " (the file is empty)"
        )
        raise ModelError(f"{path}: column {column} is missing{found}", wanted, "missing_column")


def _row(where: str, columns: list[str], cells: list[str]) -> dict[str, str]:
    if len(cells) > len(columns):
        cells = _without_empty_end(cells)
    if len(cells) > len(columns):
        said = f"{where}: has more fields than the header ({len(cells)}, not {len(columns)})"
        raise ModelError(said, COMMAS, "bad_table")
    return dict(zip(columns, cells + [""] * (len(columns) - len(cells)), strict=True))
