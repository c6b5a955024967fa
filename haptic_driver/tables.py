"""Tables that a user gives as CSV: named columns, one header line; BadInputError says file, line and column."""

from __future__ import annotations

import csv
import io
import math
from dataclasses import dataclass
from pathlib import Path

from haptic_driver.errors import BadInputError
from haptic_driver.files import read_text

COMMAS = "Save it with commas between the columns and points in the numbers: 0.5, not 0,5"


@dataclass(frozen=True)
class Table:
    """The cells of a file as text, without the spaces around them: each of `rows` by column, `lines` where it stands.

    A row that ends early has empty cells.
    """

    path: Path
    columns: list[str]
    rows: list[dict[str, str]]
    lines: list[int]

    def number(self, row: int, column: str) -> float:
        """One cell; BadInputError where it is no finite number."""
        text = self.rows[row][column]
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            raise BadInputError(
                "not_a_number", f"{self.path}, line {self.lines[row]}: {column} is {text!r}, not a number",
                "Write a plain number in SI units there, such as 0.5",
            )  # fmt: skip
        return value


def read_table(path: Path, required: tuple[str, ...], wanted: str) -> Table:
    """A table with the columns `required`; `wanted` is the hint that says what the file must look like."""
    try:
        text = read_text(path)
    except BadInputError as error:
        raise BadInputError("bad_table", error.message, f"{error.hint}. {wanted}") from None
    reader = csv.reader(io.StringIO(text, newline=""))
    try:
        numbered = [(reader.line_num, [cell.strip() for cell in cells]) for cells in reader if cells]
    except csv.Error as error:
        raise BadInputError("bad_table", f"{path}, line {reader.line_num}: is not CSV ({error})", wanted) from None
    columns = numbered[0][1] if numbered else []
    _check_columns(path, columns, required, wanted)
    for line, cells in numbered[1:]:
        if len(cells) > len(columns):
            said = f"{path}, line {line}: has more fields than the header ({len(cells)}, not {len(columns)})"
            raise BadInputError("bad_table", said, COMMAS)
    rows = [dict(zip(columns, cells + [""] * (len(columns) - len(cells)), strict=True)) for _, cells in numbered[1:]]
    return Table(path, columns, rows, [line for line, _ in numbered[1:]])


def _check_columns(path: Path, columns: list[str], required: tuple[str, ...], wanted: str) -> None:
    for separator, name in ((";", "semicolons"), ("\t", "tabs")):
        if len(columns) == 1 and separator in columns[0]:
            raise BadInputError("bad_table", f"{path}: its columns are separated by {name}", f"{COMMAS}. {wanted}")
    for column in required:
        if column not in columns:
            found = f"; found: {', '.join(columns)}" if columns else " (the file is empty)"
            raise BadInputError("missing_column", f"{path}: column {column} is missing{found}", wanted)
    for column in columns:
        if columns.count(column) > 1:
            raise BadInputError("bad_table", f"{path}: column {column} stands more than once", "Keep one of them")
