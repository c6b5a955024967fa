"""A paper on A4 pages, by fpdf2: text that can be selected, and figures as pictures.

Lengths are millimetres, sizes of letters points.
"""

from __future__ import annotations

import io
from itertools import zip_longest
from pathlib import Path

import matplotlib as mpl
from fpdf import FPDF
from fpdf.enums import Align, XPos
from fpdf.fonts import FontFace

from haptic_driver.errors import shown
from haptic_driver.files import replacing
from haptic_driver.lab.papers.document import (
    Block,
    Document,
    Figure,
    Heading,
    Paragraph,
    Table,
    picture,
)

FONT = "DejaVu"
SIDE, TOP, BOTTOM = 17.0, 16.0, 18.0
TITLE, HEADING, BODY, SMALL = 15.0, 10.0, 8.0, 6.8
LINE = 0.47  # height of a line for each point of its letters
GAP = 1.8  # between blocks, and between columns
BEGUN = 21.0  # of what follows a heading, on the page of that
SHORT_ROWS = 8  # of a table that is not broken over two pages
INK, FAINT = 26, 138


class _Paper(FPDF):
    def __init__(self, foot: str) -> None:
        super().__init__(format="A4")
        self._foot = shown(foot)
        folder = Path(mpl.get_data_path()) / "fonts" / "ttf"
        self.add_font(FONT, fname=folder / "DejaVuSans.ttf")
        self.add_font(FONT, "B", folder / "DejaVuSans-Bold.ttf")
        self.set_margins(SIDE, TOP)
        self.c_margin = 0.0
        self.set_auto_page_break(True, BOTTOM)
        self.set_creator("haptic-driver")
        self.add_page()

    def footer(self) -> None:
        """Of every page."""
        self.set_y(-0.6 * BOTTOM)
        self.lines(f"{self._foot}  ·  page {self.page_no()} of {{nb}}", SMALL, grey=FAINT)

    def lines(self, text: str, size: float, *, grey: int = INK, bold: bool = False) -> None:
        """A paragraph over the whole width."""
        self.set_font(FONT, "B" if bold else "", size)
        self.set_text_color(grey)
        said = shown(text, lines=True)
        self.multi_cell(0, LINE * size, said, align=Align.L, new_x=XPos.LMARGIN)
        self.ln(GAP)

    def block(self, block: Block) -> None:
        """Below the last."""
        match block:
            case Heading(text):
                self.ln(GAP)
                self.lines(text, HEADING, bold=True)
            case Paragraph(text, small):
                self.lines(text, SMALL if small else BODY, grey=FAINT if small else INK)
            case Table():
                self._table(block)
            case Figure():
                height_mm = block.height_mm + 2.0 * LINE * SMALL
                if self.will_page_break(height_mm):
                    self.add_page()
                self.image(io.BytesIO(picture(block, "png")), w=self.epw)
                self.lines(block.caption, SMALL, grey=FAINT)

    def _table(self, table: Table) -> None:
        """Rows stay whole; the header stands again on every page."""
        self.set_font(FONT, "", SMALL)
        self.set_text_color(INK)
        self.set_line_width(0.1)
        with self.table(
            borders_layout="HORIZONTAL_LINES",
            col_widths=tuple(table.widths),
            first_row_as_headings=any(table.header),
            headings_style=FontFace(emphasis="B"),
            line_height=LINE * SMALL,
            min_row_height=table.row_mm or None,
            padding=(0.6, GAP, 0.6, 0.0),
            text_align=Align.L,
            v_align="TOP",
        ) as rows:
            for cells in ([table.header] if any(table.header) else []) + list(table.rows):
                rows.row([shown(cell, lines=True) for cell in cells])
        self.line(self.l_margin, self.y, self.l_margin + self.epw, self.y)
        self.ln(GAP)


def write_pdf(document: Document, path: Path) -> None:
    """Write all pages, or nothing; HapticError says why not."""
    paper = _Paper(document.foot)
    paper.set_title(shown(document.title))
    paper.lines(document.title, TITLE, bold=True)
    paper.lines(document.about, BODY, grey=FAINT)
    for block, after in zip_longest(document.blocks, document.blocks[1:]):
        if isinstance(block, Heading) and _needs_a_page(paper, block, after):
            paper.add_page()
        paper.block(block)
    with replacing(path) as part:
        paper.output(str(part))


def _needs_a_page(paper: _Paper, heading: Heading, after: Block | None) -> bool:
    """A heading keeps a short table, or some lines of what follows, on its page."""
    if not isinstance(after, Table) or len(after.rows) > SHORT_ROWS:
        return bool(paper.will_page_break(BEGUN))
    with paper.offset_rendering() as rehearsed:
        rehearsed.block(heading)
        rehearsed.block(after)
    return bool(rehearsed.page_break_triggered)
