"""A paper on A4 pages, by matplotlib: text that can be selected, and figures as lines.

Lengths are points (1/72 inch) from the upper left corner of the page.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from functools import lru_cache
from itertools import zip_longest
from pathlib import Path
from typing import Any

from matplotlib.backends.backend_pdf import PdfPages
from matplotlib.figure import Figure as Sheet
from matplotlib.font_manager import FontProperties
from matplotlib.lines import Line2D
from matplotlib.textpath import text_to_path

from haptic_driver.errors import shown
from haptic_driver.files import replacing
from haptic_driver.lab.papers.document import Block, Document, Figure, Heading, Paragraph, Table
from haptic_driver.pictures.saving import pyplot

WIDTH, HEIGHT = 595.3, 841.9
LEFT, RIGHT, TOP, BOTTOM = 48.0, 48.0, 46.0, 50.0
TITLE, HEADING, BODY, SMALL = 15.0, 10.0, 8.0, 6.8  # sizes of letters
LEADING = 1.32  # of a line, in sizes of its letters
GAP = 5.0  # between blocks, and between columns
SHORT = 0.25 * HEIGHT  # a table that is not broken over two pages
MM = 72.0 / 25.4
INK, FAINT = "#1a1a1a", "#8a8a8a"
FIGURE = {"font.size": 7.0, "axes.linewidth": 0.6, "lines.linewidth": 1.1}


def write_pdf(document: Document, path: Path) -> None:
    """Write all pages, or nothing; HapticError says why not."""
    about = {"Title": shown(document.title), "Creator": "haptic-driver"}
    plt = pyplot()
    with (
        plt.rc_context({"pdf.fonttype": 42}),
        replacing(path) as part,
        PdfPages(part, metadata=about) as file,
    ):
        for sheet in sheets(document):
            file.savefig(sheet)


def sheets(document: Document) -> list[Sheet]:
    """The pages as figures of A4."""
    layout = _Layout()
    layout.lines(document.title, TITLE, bold=True)
    layout.lines(document.about, BODY, color=FAINT)
    for block, after in zip_longest(document.blocks, document.blocks[1:]):
        match block:
            case Heading(text):
                layout.heading(text, after)
            case Paragraph(text, small):
                layout.lines(text, SMALL if small else BODY, color=FAINT if small else INK)
            case Table():
                layout.table(block)
            case Figure():
                layout.figure(block)
    for number, sheet in enumerate(layout.sheets, 1):
        foot = f"{shown(document.foot)}  ·  page {number} of {len(layout.sheets)}"
        _put(sheet, (LEFT, HEIGHT - 0.6 * BOTTOM), foot, SMALL, color=FAINT)
    return layout.sheets


class _Layout:
    """Where the next block goes."""

    def __init__(self) -> None:
        self.sheets: list[Sheet] = []
        self._y = HEIGHT

    def heading(self, text: str, after: Block | None) -> None:
        """A heading keeps a short table, or some lines of what follows, on its page."""
        height = self._table_height(after) if isinstance(after, Table) else 0.0
        self._room(HEADING * LEADING + (height if 0.0 < height < SHORT else 60.0) + 3.0 * GAP)
        self._y += 1.2 * GAP
        self.lines(text, HEADING, bold=True)

    def lines(self, text: str, size: float, *, bold: bool = False, color: str = INK) -> None:
        """A paragraph over the whole width."""
        for line in broken(text, WIDTH - LEFT - RIGHT, size, bold):
            self._room(size * LEADING)
            _put(self._sheet, (LEFT, self._y + size), line, size, bold=bold, color=color)
            self._y += size * LEADING
        self._y += GAP

    def table(self, table: Table) -> None:
        """Rows stay whole; the header stands again on every page."""
        widths = _column_widths(table)
        self._header(table, widths)
        for row in table.rows:
            cells = _cells(row, widths, bold=False)
            if self._y + _height(cells, table) > HEIGHT - BOTTOM:
                self._new_sheet()
                self._header(table, widths)
            self._row(cells, widths, _height(cells, table), bold=False)
        self._y += GAP

    def _table_height(self, table: Table) -> float:
        widths = _column_widths(table)
        rows = [_height(_cells(row, widths, bold=False), table) for row in table.rows]
        header = _height(_cells(table.header, widths, bold=True), table)
        return sum(rows) + (header if any(table.header) else 0.0)

    def figure(self, figure: Figure) -> None:
        """Panels side by side, with room for their labels, and a caption below."""
        height, room = figure.height_mm * MM, 34.0
        self._room(height + 2.0 * SMALL * LEADING)
        width = (WIDTH - LEFT - RIGHT) / figure.panels
        with pyplot().rc_context(FIGURE):
            axes = [
                self._sheet.add_axes(
                    (
                        (LEFT + i * width + room) / WIDTH,
                        1.0 - (self._y + height - room * 0.8) / HEIGHT,
                        (width - room - 2.0 * GAP) / WIDTH,
                        (height - room) / HEIGHT,
                    )
                )
                for i in range(figure.panels)
            ]
            figure.draw(axes)
        self._y += height
        self.lines(figure.caption, SMALL, color=FAINT)

    @property
    def _sheet(self) -> Sheet:
        return self.sheets[-1]

    def _room(self, height: float) -> None:
        if self._y + height > HEIGHT - BOTTOM:
            self._new_sheet()

    def _new_sheet(self) -> None:
        self.sheets.append(Sheet(figsize=(WIDTH / 72.0, HEIGHT / 72.0)))
        self._y = TOP

    def _header(self, table: Table, widths: Sequence[float]) -> None:
        if not any(table.header):
            return
        cells = _cells(table.header, widths, bold=True)
        self._room(_height(cells, table) + 3.0 * SMALL * LEADING)
        self._row(cells, widths, _height(cells, None), bold=True)

    def _row(
        self, cells: Sequence[list[str]], widths: Sequence[float], height: float, *, bold: bool
    ) -> None:
        x = LEFT
        for lines, width in zip(cells, widths, strict=True):
            for i, line in enumerate(lines):
                at = x, self._y + 2.0 + SMALL * (1.0 + LEADING * i)
                _put(self._sheet, at, line, SMALL, bold=bold)
            x += width
        self._y += height
        across = [LEFT / WIDTH, 1.0 - RIGHT / WIDTH]
        rule = Line2D(across, [1.0 - self._y / HEIGHT] * 2)
        rule.set(color=INK if bold else FAINT, linewidth=0.8 if bold else 0.25)
        self._sheet.add_artist(rule)


def broken(text: str, width: float, size: float, bold: bool) -> list[str]:
    """Lines of a text that are no wider than `width`; a longer word is cut behind `/`, `_`, `:`."""
    lines: list[str] = []
    for given in shown(text, lines=True).split("\n"):
        line = ""
        for piece, space in _pieces(given, width, size, bold):
            longer = line + space + piece if line else piece
            if line and _wide(longer, size, bold) > width:
                lines.append(line)
                longer = piece
            line = longer
        lines.append(line)
    return lines


def _pieces(text: str, width: float, size: float, bold: bool) -> Iterator[tuple[str, str]]:
    """Words, or parts of long ones, each with the blank before it."""
    for word in text.split(" "):
        fits = _wide(word, size, bold) <= width
        parts = [word] if fits else [p for p in re.split(r"(?<=[_/:.])", word) if p]
        yield parts[0] if parts else "", " "
        for part in parts[1:]:
            yield part, ""


@lru_cache(maxsize=20_000)
def _wide(text: str, size: float, bold: bool) -> float:
    font = FontProperties(size=size, weight="bold" if bold else "normal")
    width, _, _ = text_to_path.get_text_width_height_descent(text, font, ismath=False)
    return float(width)


def _column_widths(table: Table) -> list[float]:
    whole = (WIDTH - LEFT - RIGHT) / sum(table.widths)
    return [share * whole for share in table.widths]


def _cells(row: Sequence[str], widths: Sequence[float], *, bold: bool) -> list[list[str]]:
    pairs = zip(row, widths, strict=True)
    return [broken(cell, width - GAP, SMALL, bold) for cell, width in pairs]


def _height(cells: Sequence[list[str]], table: Table | None) -> float:
    lines = max(len(cell) for cell in cells)
    least = 0.0 if table is None else table.row_mm * MM
    return max(SMALL * LEADING * lines + 3.5, least)


def _put(sheet: Sheet, at: tuple[float, float], text: str, size: float, **how: Any) -> None:
    """A line of text whose baseline begins at this place."""
    x, y = at
    weight = "bold" if how.pop("bold", False) else "normal"
    place = x / WIDTH, 1.0 - y / HEIGHT
    sheet.text(*place, text, size=size, weight=weight, parse_math=False, **{"color": INK} | how)
