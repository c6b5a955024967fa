"""How papers are laid out: nothing leaves its page, is lost, or is taken for markup."""

from __future__ import annotations

import datetime
import json
import re

import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg

from haptic_driver.errors import BadInputError
from haptic_driver.lab.papers.document import (
    Document,
    Figure,
    Heading,
    Paragraph,
    Table,
    page,
    write,
)
from haptic_driver.lab.papers.pdf import WIDTH, broken, sheets
from haptic_driver.lab.papers.safety import safety_file
from haptic_driver.lab.papers.safety_facts import inspect

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


@pytest.mark.parametrize("made", ["own", "safety"])
def test_no_text_leaves_its_page_or_lies_on_another(made: str) -> None:
    paper = document(60)
    if made == "safety":
        paper = safety_file(inspect("paper", "reference", datetime.date(2026, 3, 1)))
    for sheet in sheets(paper):
        sheet.set_dpi(432)  # letters are placed in whole pixels
        renderer = FigureCanvasAgg(sheet).get_renderer()
        width, height = sheet.bbox.width, sheet.bbox.height
        boxes = [text.get_window_extent(renderer) for text in sheet.texts if text.get_text()]
        for box in boxes:
            assert 0.06 * width < box.x0 < box.x1 < 0.94 * width
            assert 0.02 * height < box.y0 < box.y1 < 0.97 * height
        for i, one in enumerate(boxes):
            for other in boxes[:i]:
                across = min(one.x1, other.x1) - max(one.x0, other.x0)
                along = min(one.y1, other.y1) - max(one.y0, other.y0)
                assert across <= 0.0 or along <= 1.0


def test_every_row_is_on_one_page_below_a_header() -> None:
    texts = [[text.get_text() for text in sheet.texts] for sheet in sheets(document(60))]
    assert len(texts) > 1
    assert sum(text.count("first") for text in texts) == len(
        [text for text in texts if any(line.startswith("row ") for line in text)]
    )
    for i in range(60):
        assert sum(text.count(f"row {i}") for text in texts) == 1


def test_the_safety_file_has_two_to_four_pages() -> None:
    paper = safety_file(inspect("paper", "reference", datetime.date(2026, 3, 1)))
    assert 2 <= len(sheets(paper)) <= 4


def test_lines_keep_every_letter_and_their_width() -> None:
    lines = broken(f"some words {LONG} and more", 100.0, 8.0, False)
    assert re.sub(r"\s", "", "".join(lines)) == f"somewords{LONG}andmore"
    assert len(lines) > 8


def test_a_page_escapes_what_it_is_given_and_loads_nothing() -> None:
    text = page(document())
    assert "<script" not in text
    assert "\x1b" not in text
    assert "&lt;script&gt;" in text
    assert not re.search(r"(?:src|href)\s*=\s*[\"'](?!#)", text.replace("xlink:href", "href"))


def test_a_pdf_is_written_whole(tmp_path) -> None:
    write(document(), tmp_path / "new" / "paper.pdf")
    content = (tmp_path / "new" / "paper.pdf").read_bytes()
    assert content.startswith(b"%PDF")
    assert content.rstrip().endswith(b"%%EOF")
    assert f"/MediaBox [ 0 0 {WIDTH:g} ".encode() in content
    assert len(list((tmp_path / "new").iterdir())) == 1


def test_json_is_the_facts(tmp_path) -> None:
    write(document(), tmp_path / "paper.JSON")
    assert json.loads((tmp_path / "paper.JSON").read_text()) == {"answer": 1.5}


def test_another_ending_is_refused(tmp_path) -> None:
    with pytest.raises(BadInputError, match="no name of a paper"):
        write(document(), tmp_path / "paper.docx")


def test_a_short_table_stays_with_its_heading_on_one_page() -> None:
    rows = [("role", "name")] * 6
    for lines in range(30, 60):  # whatever place on the page is left for it
        blocks = [Paragraph("\n".join(["text"] * lines)), Heading("Signatures")]
        paper = Document("title", "about", "foot", [*blocks, Table(("a", "b"), rows, (1, 1))], {})
        counts = [
            sum(text.get_text() == "role" for text in sheet.texts)
            for sheet in sheets(paper)
            if any(text.get_text() == "Signatures" for text in sheet.texts)
        ]
        assert counts == [6]
