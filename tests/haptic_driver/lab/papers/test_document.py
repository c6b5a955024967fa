"""How papers are laid out: nothing leaves its page, is lost, or is taken for markup."""

from __future__ import annotations

import datetime
import re
from pathlib import Path

import pytest
from pypdf import PdfReader

from haptic_driver.lab.papers.document import Document, Figure, Heading, Paragraph, Table
from haptic_driver.lab.papers.safety import safety_file
from haptic_driver.lab.papers.safety_facts import inspect
from haptic_driver.lab.papers.write import page, write

WORDS = "a name $x_1$ <script>alert(1)</script> & \x1b[31m more"
LONG = "tests/a_folder/" + "a_part_of_a_name_" * 12 + "end"


def document(rows: int = 3) -> Document:
    return Document(
        title=WORDS,
        about="about it",
        foot="foot",
        blocks=[
            Heading("heading"),
            Paragraph(f"{WORDS} {LONG} " * 3),
            Table(("first", "second"), [(f"row {i}", LONG) for i in range(rows)], (1, 3)),
            Figure(lambda axes: axes[0].plot([0, 1], [0, 1]), height_mm=40.0, caption="a line"),
        ],
        facts={"answer": 1.5},
    )


def pages(paper: Document, folder: Path) -> list[list[str]]:
    """The lines of text on each page of the PDF."""
    write(paper, folder / "new" / "paper.pdf")
    return [
        one.extract_text().splitlines() for one in PdfReader(folder / "new" / "paper.pdf").pages
    ]


def test_every_row_is_on_one_page_below_a_header(tmp_path):
    found = pages(document(60), tmp_path)
    assert len(found) > 1
    rows = [[line for line in lines if line.startswith("row ")] for lines in found]
    assert [line.split()[1] for lines in rows for line in lines] == [str(i) for i in range(60)]
    for number, (lines, there) in enumerate(zip(found, rows, strict=True), 1):
        assert lines.count("first second") == bool(there)
        assert lines[-1] == f"foot  ·  page {number} of {len(found)}"
    letters = re.sub(r"\s", "", "".join(line for lines in found for line in lines[:-1]))
    assert letters.count(LONG) == 3 + 60  # in the paragraph, and once a row


def test_what_does_not_print_is_shown_as_it_is_written(tmp_path):
    text = "\n".join(pages(document(), tmp_path)[0])
    assert "$x_1$ <script>alert(1)</script> & \\x1b[31m more" in text
    assert [path.name for path in (tmp_path / "new").iterdir()] == ["paper.pdf"]


def test_the_safety_file_has_two_to_four_pages(tmp_path):
    paper = safety_file(inspect("paper", "reference", datetime.date(2026, 3, 1)))
    assert 2 <= len(pages(paper, tmp_path)) <= 4


def test_a_page_escapes_what_it_is_given_and_loads_nothing():
    text = page(document())
    assert "<script" not in text
    assert "\x1b" not in text
    assert "&lt;script&gt;" in text
    assert not re.search(r"(?:src|href)\s*=\s*[\"'](?!#)", text.replace("xlink:href", "href"))


@pytest.mark.parametrize("lines", range(44, 76, 8))  # whatever place is left on the page
def test_a_short_table_stays_with_its_heading_on_one_page(tmp_path, lines):
    rows = [("role", "name")] * 6
    blocks = [Paragraph("\n".join(["text"] * lines)), Heading("Signatures")]
    paper = Document("title", "about", "foot", [*blocks, Table(("a", "b"), rows, (1, 1))], {})
    counts = [p.count("role name") for p in pages(paper, tmp_path) if "Signatures" in p]
    assert counts == [6]
