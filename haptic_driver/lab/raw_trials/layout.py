"""Where the table of a text stands: its separator, header, units and rows of numbers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from model.support.errors import ModelError
from model.support.text import SEPARATORS, Decimal, Line, decoded, is_value, split
from model.support.units import named_unit, understood

HEADER_LINES = 1000  # in which a header is looked for
SURE = 5  # lines of numbers after which a table is believed
LABVIEW = "LabVIEW Measurement"
LABVIEW_END = "***End_of_Header***"


@dataclass(frozen=True)
class Layout:
    """What a person says of a text; what is None is found. `table`: which of several, from 1."""

    separator: str | None = None
    decimal: Decimal | None = None
    header_line: int | None = None
    units_row: bool | None = None
    encoding: str | None = None
    table: int | None = None


@dataclass(frozen=True)
class TextTable:
    """A table of a text: names and units by column as written, and the lines of its numbers.

    `header_line` counts from 1, and is 0 where there are no names. `units_row`: units stand below
    the names.
    """

    path: Path
    separator: str
    decimal: Decimal | None
    names: list[str]
    units: list[str]
    rows: list[Line]
    header_line: int
    units_row: bool
    is_labview: bool = False

    @property
    def width(self) -> int:
        """The number of columns."""
        return max(len(self.names), len(self.rows[0].cells) if self.rows else 0)

    def cells(self, place: int) -> list[str]:
        """One column, empty where a row ends early."""
        return [row.cells[place] if place < len(row.cells) else "" for row in self.rows]


def text_table(
    path: Path, content: bytes, said: Layout, wanted: Sequence[str] = (), labview: bool = False
) -> TextTable:
    """The table of a text, found by the names `wanted`, or else by its first lines of numbers.

    ModelError for a text without a table, with several, or with rows that its header cannot mean.
    """
    text = decoded(path, content, said.encoding)
    if labview or text.startswith(LABVIEW):
        table = _labview(path, text, said.table)
    else:
        table = _one_table(_found(path, text, said, wanted), said.table)
    _check_widths(table)
    if not table.rows:
        raise ModelError(f"{path}: no numbers stand below its header", "Is it whole?", "bad_table")
    return table


def _found(path: Path, text: str, said: Layout, wanted: Sequence[str]) -> TextTable:
    head = "".join(text.splitlines(keepends=True)[: HEADER_LINES + SURE])
    tried: list[tuple[str, int]] = []
    for separator in [said.separator] if said.separator else SEPARATORS:
        try:
            lines = split(path, head, separator)
        except ModelError:
            if said.separator:
                raise
            continue
        at = _header(lines, said, wanted)
        if at is not None:
            tried.append((separator, at))
            if wanted or said.header_line is not None:
                break
    if not tried:
        said_no = f"{path}: no {SURE} lines of numbers follow one another"
        raise ModelError(said_no, "Is it a text? See docs/own-data.md", "bad_table")
    separator, at = tried[0]
    return _table(path, split(path, text, separator), separator, at, said)


def _header(lines: Sequence[Line], said: Layout, wanted: Sequence[str]) -> int | None:
    """Which of the lines has the names, -1 where none has any; None where no table is found."""
    if said.header_line is not None:
        if not said.separator and _first_row(lines) is None:
            return None
        numbers = [line.number for line in lines]
        return numbers.index(said.header_line) if said.header_line in numbers else -1
    for i, line in enumerate(lines):
        if wanted and is_header(line.cells, wanted):
            return i
    first = _first_row(lines)
    if first is None:
        return None
    width = len(_filled(lines[first].cells))
    above = [i for i in range(max(first - 3, 0), first) if len(lines[i].cells) >= width]
    if len(above) > 1 and _is_units(lines[above[-1]].cells):
        above.pop()
    return above[-1] if above else -1


def is_header(cells: Sequence[str], wanted: Sequence[str]) -> bool:
    """Whether a line has all names, with or without units behind them."""
    bare = {named_unit(cell).bare for cell in cells} | set(cells) if len(cells) > 1 else set(cells)
    return set(wanted) <= bare


def _first_row(lines: Sequence[Line]) -> int | None:
    """Where SURE lines of equally many cells begin, at least half of each being numbers."""
    widths = []
    for line in lines:
        cells = _filled(line.cells)
        numeric = sum(map(is_value, cells))
        widths.append(len(line.cells) if numeric > 1 and 2 * numeric >= len(cells) else 0)
    for i in range(len(widths) - SURE + 1):
        if widths[i] and len(set(widths[i : i + SURE])) == 1:
            return i
    return None


def _filled(cells: Sequence[str]) -> list[str]:
    return [cell for cell in cells if cell]


def _is_units(cells: Sequence[str]) -> bool:
    """Whether a line has units alone."""
    units = [cell.strip("[]() ") for cell in cells]
    return any(units) and all(
        not u or (understood(u) is not None and not is_value(u)) for u in units
    )


def _table(path: Path, lines: list[Line], separator: str, at: int, said: Layout) -> TextTable:
    names = lines[at].cells if at >= 0 else []
    rows = lines[at + 1 :]
    if at < 0 and said.header_line is None:
        rows = rows[_first_row(lines) or 0 :]
    rows = [line for line in rows if any(line.cells)]
    has_units = said.units_row
    if has_units is None:  # a column of units in each row is none below the names
        has_units = bool(names) and [_is_units(row.cells) for row in rows[:2]] == [True, False]
    units = [cell.strip("[]() ") for cell in rows[0].cells] if has_units and rows else []
    header_line = lines[at].number if at >= 0 else 0
    kept = rows[1:] if has_units else rows
    return TextTable(
        path, separator, said.decimal, names, units, kept, header_line, bool(has_units)
    )


def _labview(path: Path, text: str, number: int | None) -> TextTable:
    """A table of a LabVIEW measurement file, whose header says how it is written."""
    head = text[: text.find(LABVIEW_END)]
    said = dict(line.split(None, 1) for line in head.splitlines() if len(line.split(None, 1)) > 1)
    separator = "," if said.get("Separator", "Tab").strip() == "Comma" else "tab"
    decimal: Decimal = "," if said.get("Decimal_Separator", ".").strip() == "," else "."
    lines = split(path, text, separator)
    ends = [i for i, line in enumerate(lines) if line.cells[:1] == [LABVIEW_END]]
    if not ends or ends[-1] + 1 >= len(lines):
        raise ModelError(f"{path}: has no {LABVIEW_END}, as LabVIEW writes it", "", "bad_table")
    starts = [i + 1 for i in ends[1:] or ends]
    channels = [i for i, line in enumerate(lines) if line.cells[:1] == ["Channels"]]
    heads = [max((i for i in channels if i < start), default=ends[0]) for start in starts]
    stops = [*heads[1:], len(lines)]
    parts = [[x for x in lines[i:j] if any(x.cells)] for i, j in zip(starts, stops, strict=True)]
    spans = [(part[0].number, part[-1].number) for part in parts]
    place = _chosen(path, spans, number)
    head_lines = lines[heads[place] : starts[place]]
    about = {line.cells[0]: line.cells[1:] for line in head_lines if line.cells}
    header, *rows = parts[place]
    names = header.cells
    units = _labview_units(names, about)
    header_line = header.number
    return TextTable(path, separator, decimal, names, units, rows, header_line, False, True)


def _labview_units(names: Sequence[str], about: dict[str, list[str]]) -> list[str]:
    """A unit a column: s for what LabVIEW calls X_Value, and the channels' own in their order."""
    of_channels = iter(about.get("Y_Unit_Label", []))
    in_time = "Time" in about.get("X_Dimension", ["Time"])
    x_unit = "s" if in_time else ""
    return [x_unit if name in ("X_Value", "") else next(of_channels, "") for name in names]


def _one_table(table: TextTable, number: int | None) -> TextTable:
    """A text's only table, or that of a number from 1 where the header stands again; ModelError."""
    again = [i for i, row in enumerate(table.rows) if table.names and row.cells == table.names]
    stops = [*again, len(table.rows)]
    headers = [table.header_line, *(table.rows[i].number for i in again)]
    if again:  # a title above a header is no row
        numeric = [2 * sum(map(is_value, row.cells)) >= len(table.names) for row in table.rows]
        stops = [max((i + 1 for i in range(stop) if numeric[i]), default=0) for stop in stops]
    ends = [table.rows[stop - 1].number if stop else 0 for stop in stops]
    place = _chosen(table.path, list(zip(headers, ends, strict=True)), number)
    first = again[place - 1] + 1 + table.units_row if place else 0
    return replace(table, rows=table.rows[first : stops[place]], header_line=headers[place])


def _chosen(path: Path, spans: Sequence[tuple[int, int]], number: int | None) -> int:
    """Which of the tables in these lines is meant, from 0; ModelError where nobody says it."""
    if number is None and len(spans) == 1:
        return 0
    if number is not None and number <= len(spans):
        return number - 1
    listed = ", ".join(f"{first} to {last}" for first, last in spans[:10])
    count = f"{len(spans)} tables" if len(spans) > 1 else "one table"
    said = f"{path}: holds {count}, in lines {listed}"
    hint = "To take one: file.table = 1, 2, ...; or save each as a file of its own"
    raise ModelError(said, hint, "several_tables")


def _check_widths(table: TextTable) -> None:
    """ModelError for a row of more cells than there are names, and for names without any cells."""
    count = len(table.names)
    if not any(table.names):
        return
    hint = "Is it whole? A comma as decimal sign or in a name needs another separator, or quotes"
    for row in table.rows:
        if any(row.cells[count:]):
            said = (
                f"{table.path}, line {row.number}: has {len(row.cells)} cells under {count} names"
            )
            raise ModelError(said, hint, "bad_table")
    widest = max((len(row.cells) for row in table.rows), default=count)
    if any(table.names[widest:]) and not table.is_labview:
        said = f"{table.path}: its rows have at most {widest} cells under {count} names"
        raise ModelError(said, hint, "bad_table")
