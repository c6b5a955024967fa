"""Tables that a user gives as CSV: named columns, one header line; ModelError says file, line and
column.
"""

from __future__ import annotations

import csv
import hashlib
import io
import math
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import islice, pairwise
from pathlib import Path
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from model.support.cells import is_number, number, read_cell
from model.support.errors import ModelError, did_you_mean
from model.support.reading import LARGEST_FILE_BYTES, read_bytes
from model.support.text import decoded, is_value, plain
from model.support.units import (
    PEAK_OF_RMS,
    by_other_names,
    contradicts,
    differ,
    is_rms,
    named_unit,
    near,
    to_column,
    unit_in_name,
    unit_of,
)

UNIT_BEHIND = re.compile(r".*\S\s*\[(.+)\]")
MOST_LISTED = 30  # cells that an error names
ROW_BYTES = 100  # where rows are limited
MOST_SAID = 40  # columns that an error names
HEADER_LINES = 100  # of a file, in which its header is looked for
COMMAS = "Save it with commas between the columns and points in the numbers: 0.5, not 0,5"
ONE_NAME = "Give each column one name in the header, and each number a point: 0.5, not 0,5"


class Named(NamedTuple):
    """A column as a file calls it, and its unit, empty where only its own name may say it.

    Unless `needed`, a file without that column is read under our own name.
    """

    column: str
    unit: str = ""
    needed: bool = True


NO_NAMES: Mapping[str, Named] = MappingProxyType({})


class BadRowsError(ModelError):
    """What is wrong in several rows, or in one."""


@dataclass(frozen=True)
class Table:
    """The cells of a file as text, without the spaces around them: each of `rows` by column,
    `lines` where it stands.

    A row that ends early has empty cells. Empty rows, lines that begin with #, and empty columns
    without a name at the end are left out. `wanted` is the hint that says what the file must look
    like; `content_hash` the SHA-256 of the file. `notes`: what its reader took another way than it
    stands there. `added`: columns under our names that are not in the file. `wrong`: by row what
    its reader cannot use, to report all rows at once.
    """

    path: Path
    columns: list[str]
    rows: list[dict[str, str]]
    lines: list[int]
    wanted: str
    content_hash: str
    notes: tuple[str, ...] = ()
    added: tuple[str, ...] = ()
    wrong: dict[int, list[ModelError]] = field(default_factory=dict)

    def refuse(self, row: int, error: ModelError) -> None:
        """Note what is wrong in a row, its message beginning with `where`."""
        self.wrong.setdefault(row, []).append(error)

    def without_wrong(self) -> Table:
        """The rows in which nothing is wrong."""
        kept = [i for i in range(len(self.rows)) if i not in self.wrong]
        rows, lines = [self.rows[i] for i in kept], [self.lines[i] for i in kept]
        return replace(self, rows=rows, lines=lines, wrong={})

    def said_wrong(self) -> tuple[str, ...]:
        """What is wrong, a text for each line of the file that has something."""
        return tuple(f"line {line}: {reasons}" for line, reasons in self._reasons().items())

    def _reasons(self) -> dict[int, str]:
        """What is wrong in each line of the file that has something."""
        told = {}
        for row, faults in sorted(self.wrong.items()):
            reasons = [fault.message.removeprefix(f"{self.where(row)}: ") for fault in faults]
            told[self.lines[row]] = ", ".join(reasons)
        return told

    def bad_rows(self) -> BadRowsError:
        """All that is wrong as one error, each reason once."""
        faults = [fault for _, found in sorted(self.wrong.items()) for fault in found]
        hint = ". ".join(dict.fromkeys(fault.hint for fault in faults)).replace("?.", "?")
        if len(faults) == 1:
            return BadRowsError(faults[0].message, hint, faults[0].code)
        lines = dict[str, list[int]]()
        for line, reasons in self._reasons().items():
            lines.setdefault(reasons, []).append(line)
        listed = [f"{_lines(having)}: {reasons}" for reasons, having in lines.items()]
        more = f"; and {len(listed) - MOST_LISTED} more" if len(listed) > MOST_LISTED else ""
        said = f"{len(self.wrong)} of {len(self.rows)} rows cannot be used: "
        message = f"{self.path}: {said}{'; '.join(listed[:MOST_LISTED])}{more}"
        return BadRowsError(message, hint, "bad_rows")

    def require(self, column: str) -> None:
        """ModelError where there is no such column."""
        if column not in self.columns:
            found = [name for name in self.columns if name not in self.added]
            _require(self.path, found, column, self.wanted)

    def text(self, column: str) -> list[str]:
        """One column as it is written."""
        return [row[column] for row in self.rows]

    def doubted(self) -> tuple[str, ...]:
        """What the rows say in a column `doubts`, as those of raw trials do."""
        told = [said for said in self.text("doubts") if said] if "doubts" in self.columns else []
        if not told:
            return ()
        return (f"{len(told)} of {len(self.rows)} rows are in doubt, the first: {told[0]}",)

    def number(self, row: int, column: str) -> float:
        """One cell; ModelError where it is no finite number."""
        text = self.rows[row][column]
        try:
            value = number(text)
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

    def require_rising(self, column: str, values: NDArray[np.float64], hint: str) -> None:
        """ModelError where the numbers [n] of a column do not rise from row to row: whether they
        repeat, begin again or lie in no order. `hint`: what to do about several runs in one file.
        """
        steps = np.diff(values)
        if not (steps <= 0.0).any():
            return
        back = np.flatnonzero(steps < 0.0) + 1
        row = int(back[0]) if back.size else int(np.argmax(steps <= 0.0)) + 1
        said = f"{self.where(row)}: {column} does not rise: "
        if not back.size:
            same = int((steps == 0.0).sum())
            said += (
                f"{values[row]:.9g} again, as {same} of {values.size} rows repeat the one before"
            )
            hint = "Write it with more digits, or keep one row of each"
        elif _begins_again(values, back):
            said += (
                f"it begins again, from {values[row - 1]:.6g} to {values[row]:.6g}:"
                f" {back.size + 1} runs in one file"
            )
        else:
            said += f"{values[row]:.9g} after {values[row - 1]:.9g}"
            hint = f"Sort the rows by {column}"
        raise ModelError(said, hint, "bad_table")

    def where(self, row: int) -> str:
        """File and line of a row."""
        return f"{self.path}, line {self.lines[row]}"


def _lines(numbers: Sequence[int]) -> str:
    """Lines in words, those that follow one another together."""
    runs = [[numbers[0], numbers[0]]]
    for before, line in pairwise(numbers):
        if line > before + 1:
            runs.append([line, line])
        runs[-1][1] = line
    said = [f"{first}" if first == last else f"{first} to {last}" for first, last in runs]
    return f"line{'s' if len(numbers) > 1 else ''} {', '.join(said)}"


def _begins_again(values: NDArray[np.float64], back: NDArray[np.intp]) -> bool:
    """Whether values that fall at some rows fall to about where they began."""
    near = 0.1 * (values.max() - values[0])
    return bool(3 * back.size <= values.size and np.all(np.abs(values[back] - values[0]) <= near))


def read_table(
    path: Path,
    required: Sequence[str],
    wanted: str,
    most_rows: int | None = None,
    known: Sequence[str] = (),
    at_once: bool = False,
    named: Mapping[str, Named] = NO_NAMES,
) -> Table:
    """A table with the columns `required`; `wanted` is the hint that says what the file must look
    like. By the names `known`, or required, a header is found that is not in the first line.

    `at_once`: a row that is too long is noted in `wrong`, and refuses nothing by itself. `named`:
    columns of the file that count, times a factor, as the columns of our names; they are added.
    """
    try:
        content = read_bytes(
            path, LARGEST_FILE_BYTES if most_rows is None else most_rows * ROW_BYTES
        )
        text = decoded(path, content)
    except ModelError as error:
        raise ModelError(error.message, f"{error.hint}. {wanted}", error.code) from None
    separator = _separator(text)
    reader = csv.reader(io.StringIO(text, newline=""), delimiter=separator)
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
    if numbered and numbered[0][1] and _is_sep_line(numbered[0][1]):
        numbered = numbered[1:]
    first_lines = numbered[:HEADER_LINES]
    numbered = [
        (line, cells) for line, cells in numbered if any(cells) and not cells[0].startswith("#")
    ]
    columns = _without_empty_end(numbered[0][1]) if numbered else []
    named, notes = _with_near(path, columns, [*required, *known], named)
    used = {ours: one for ours, one in named.items() if _is_used(ours, one, columns)}
    required = [name for name in required if name not in used]
    required += [one.column for one in used.values()]
    names = [*required, *known]
    if columns and (not set(columns) >= set(required) or not set(columns) & set(names)):
        _check_header(path, numbered[0], first_lines, names, wanted)
        _check_no_preamble(path, numbered[:HEADER_LINES], wanted)
    _check_columns(path, columns, required, wanted)
    has_points = any("." in cell for _, cells in numbered[1:HEADER_LINES] for cell in cells)
    hint = ONE_NAME if has_points else COMMAS
    lines = [line for line, _ in numbered[1:]]
    content_hash = hashlib.sha256(content).hexdigest()
    table = Table(path, columns, [], lines, wanted, content_hash, notes)
    for line, cells in numbered[1:]:
        try:
            table.rows.append(_row(f"{path}, line {line}", columns, cells, hint))
        except ModelError as error:
            if not at_once:
                raise
            table.refuse(len(table.rows), error)
            table.rows.append(dict.fromkeys(columns, ""))
    table = table if separator == "," else _with_points(table)
    table = _under_our_names(table, used) if used else table
    taken = {one.column for one in used.values()}
    _check_agree(table, [name for name in names if name in table.columns], taken)
    return table


def _check_agree(table: Table, names: Sequence[str], taken: set[str]) -> None:
    """ModelError where a column says in another unit what one of ours says otherwise."""
    for ours in names:
        rest = [name for name in table.columns if name not in taken]
        for other in by_other_names(rest, ours):
            cells = _in_ours(table, ours, Named(*other)) if other.unit else []
            wrong = [i for i, cell in enumerate(cells) if differ(table.rows[i][ours], cell)]
            if wrong:
                said = f"{table.where(wrong[0])}: {ours} and {other.column} say one quantity twice"
                raise ModelError(f"{said}, and differ", "Keep one, or rename it", "bad_table")


def _separator(text: str) -> str:
    """What separates the columns: semicolons and tabs where the header has no commas."""
    lines = (line for line in text.splitlines() if line.strip() and not line.startswith("#"))
    header = next(lines, "")
    if header.lower().startswith("sep="):
        header = next(lines, "") if len(header) == len("sep=") + 1 else header
    found = [mark for mark in (";", "\t") if mark in header and "," not in header]
    return found[0] if len(found) == 1 else ","


def _with_near(
    path: Path, columns: Sequence[str], names: Sequence[str], named: Mapping[str, Named]
) -> tuple[Mapping[str, Named], tuple[str, ...]]:
    """What a person named, and columns whose own names say that they are ours in another unit.

    ModelError for one of ours without a unit: nobody would miss it.
    """
    named = {ours: one._replace(column=_called(columns, one.column)) for ours, one in named.items()}
    taken = {one.column for one in named.values()}
    found, notes = dict(named), []
    for ours, one in named.items():
        own = unit_in_name(one.column, ours) if one.column in columns else ""
        unknown = UNIT_BEHIND.fullmatch(one.column)
        if unknown and not own and not one.unit and unit_of(ours) is not None:
            said = f"{path}: column {one.column} is in {unknown[1]}, which is no unit known here"
            hint = f"Say --column {ours}='{one.column}':UNIT"
            raise ModelError(said, hint, "bad_column")
        if own and one.unit and contradicts(one.unit, own):
            said = f"{path}: column {one.column} is in {own} by its name, and {one.unit} is said"
            hint = f"Say --column {ours}={one.column}, or rename the column"
            raise ModelError(said, hint, "bad_column")
        if own and not one.unit:
            found[ours] = one._replace(unit=own)
            factor = to_column(ours, own, f"{path}: {one.column}")
            notes.append(f"column {one.column} counts as {ours}, times {factor:g}")
    asked = [name for name in names if name not in named]
    for ours, other in near([c for c in columns if c not in taken], asked).items():
        if not other.unit:
            said = f"{path}: column {other.column} may be {ours}, and its name has no unit"
            hint = f"Call it {ours}, or say --column {ours}={other.column}:{unit_of(ours)}"
            raise ModelError(said, hint, "near_name")
        factor = to_column(ours, other.unit, f"{path}: {other.column}")
        found[ours] = Named(other.column, other.unit)
        notes.append(f"column {other.column} counts as {ours}, times {factor:g}")
    return found, tuple(notes)


def _called(columns: Sequence[str], name: str) -> str:
    """The column of that name; where there is none, the only one that has a unit behind it."""
    bare = [column for column in columns if named_unit(column).bare == name]
    return bare[0] if name not in columns and len(bare) == 1 else name


def _with_points(table: Table) -> Table:
    """The cells of a table that separates by others than commas, with points in their numbers."""
    columns = {}
    for name in table.columns:
        cells = table.text(name)
        are_numbers = all(is_value(cell) for cell in cells if "," in cell)
        columns[name] = plain(f"{table.path}: {name}", cells) if are_numbers else cells
    rows = [dict(zip(columns, cells, strict=True)) for cells in zip(*columns.values(), strict=True)]
    return replace(table, rows=rows)


def _is_used(ours: str, one: Named, columns: Sequence[str]) -> bool:
    return one.needed or one.column in columns or ours not in columns


def _under_our_names(table: Table, named: Mapping[str, Named]) -> Table:
    columns = {ours: _in_ours(table, ours, one) for ours, one in named.items()}
    rows = [row | {ours: columns[ours][i] for ours in named} for i, row in enumerate(table.rows)]
    added = [ours for ours in named if ours not in table.columns]
    return replace(table, columns=[*table.columns, *added], rows=rows, added=tuple(added))


def _in_ours(table: Table, ours: str, one: Named) -> list[str]:
    """A column's cells in the unit of our name.

    Root mean squares are those of a sine, unless a column `waveform` says another.
    """
    factor = to_column(ours, one.unit, one.column) if one.unit else 1.0
    cells = []
    for row in table.rows:
        waveform = row.get("waveform", "").lower() or "sine"
        of_wave = 1.0
        if waveform in PEAK_OF_RMS and is_rms(one.unit):
            of_wave = PEAK_OF_RMS[waveform] / PEAK_OF_RMS["sine"]
        cells.append(_times(row[one.column], factor * of_wave))
    return cells


def _times(cell: str, factor: float) -> str:
    """A cell in our unit; what is no number stays, for who reads it to refuse."""
    try:
        return cell if factor == 1.0 else repr(factor * number(cell))
    except ValueError:
        return cell


def _without_empty_end(cells: list[str]) -> list[str]:
    """Cells up to the last that says something: spreadsheets leave commas behind."""
    last = next((i for i in range(len(cells), 0, -1) if cells[i - 1]), 0)
    return cells[:last]


def _is_sep_line(cells: list[str]) -> bool:
    """Whether a first line says the separator alone, as spreadsheets do: sep=,"""
    return cells[0].lower().startswith("sep=") and len(",".join(cells)) <= len("sep=,") + 1


def _check_header(
    path: Path,
    header: tuple[int, list[str]],
    lines: Sequence[tuple[int, list[str]]],
    known: Sequence[str],
    wanted: str,
) -> None:
    """ModelError where another of the first `lines` is the header, or none is."""

    def names(cells: list[str]) -> list[str]:
        bare = [cells[0].lstrip("# \t"), *cells[1:]] if cells else []
        return [name.strip() for cell in bare for name in re.split(r"[;\t]", cell)]

    def known_in(cells: list[str]) -> int:
        return len(set(names(cells)) & set(known))

    at, cells = header
    best = max(lines, key=lambda each: known_in(each[1]))
    if known_in(best[1]) > known_in(cells):
        line, found = best
        if found[0].startswith("#"):
            said, hint = f"its header is commented out, in line {line}", "Remove the # before it"
            raise ModelError(f"{path}: {said}", f"{hint}. {wanted}", "bad_table")
        raise _preamble(path, line, wanted)
    if all(map(is_number, filter(None, names(cells)))):
        said = f"{path}, line {at}: holds numbers where the names of the columns should stand"
        raise ModelError(said, f"Give a header. {wanted}", "bad_table")
    if len(cells) == 1 and set(cells[0].split(" ")) & set(known) - {cells[0]}:
        said = f"{path}: its columns are separated by spaces"
        raise ModelError(said, f"{COMMAS}. {wanted}", "bad_table")


def _check_no_preamble(path: Path, lines: Sequence[tuple[int, list[str]]], wanted: str) -> None:
    """ModelError where a line of more names than the first comes before any row of numbers."""
    width = len(_without_empty_end(lines[0][1]))
    for line, cells in lines[1:]:
        numeric = [is_number(cell) for cell in cells if cell]
        if all(numeric):
            return
        if not any(numeric) and len(_without_empty_end(cells)) > width:
            raise _preamble(path, line, wanted)


def _preamble(path: Path, line: int, wanted: str) -> ModelError:
    return ModelError(
        f"{path}: its header stands in line {line}, below what is no part of the table",
        f"Delete the lines above line {line}, or begin each of them with #. {wanted}",
        "bad_table",
    )


def _check_columns(path: Path, columns: list[str], required: Sequence[str], wanted: str) -> None:
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
        said = f"{path}: column {column} is missing{found}"
        hint = f"{did_you_mean(column, columns)}{wanted}"
        raise ModelError(said, hint, "missing_column")


def _row(where: str, columns: list[str], cells: list[str], hint: str) -> dict[str, str]:
    if len(cells) > len(columns):
        cells = _without_empty_end(cells)
    if len(cells) > len(columns):
        said = f"{where}: has more fields than the header ({len(cells)}, not {len(columns)})"
        raise ModelError(said, hint, "bad_table")
    return dict(zip(columns, cells + [""] * (len(columns) - len(cells)), strict=True))
