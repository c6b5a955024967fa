"""A paper written as PDF, HTML or JSON, by the ending of its name.

`pdf.py` lays it out on A4, `page` here as one file of HTML that loads nothing from elsewhere. JSON
holds the facts that its blocks were made of.
"""

from __future__ import annotations

import json
from html import escape
from pathlib import Path

from haptic_driver.errors import shown
from haptic_driver.files import require_ending, write_text
from haptic_driver.lab.papers.document import (
    Block,
    Document,
    Figure,
    Heading,
    Paragraph,
    Table,
    picture,
)

ENDINGS = (".pdf", ".html", ".json")
STYLE = """
body { font: 15px/1.45 system-ui, sans-serif; max-width: 62em; margin: 2em auto; padding: 0 1em;
  color: #1a1a1a; background: #fff; overflow-wrap: break-word; }
h1 { font-size: 1.5em; margin-bottom: 0.1em; } h2 { font-size: 1.1em; margin: 1.6em 0 0.3em; }
.about, .small, figcaption { color: #555; font-size: 0.87em; }
table { border-collapse: collapse; width: 100%; font-size: 0.87em; table-layout: fixed; }
th { text-align: left; border-bottom: 1.5px solid #1a1a1a; }
td { border-bottom: 1px solid #ccc; vertical-align: top; }
th, td { padding: 0.25em 0.8em 0.25em 0; }
figure { margin: 1em 0; } svg { max-width: 100%; height: auto; }
@media print { body { margin: 0; } h2 { break-after: avoid; } tr, figure { break-inside: avoid; } }
"""


def write(document: Document, path: Path) -> None:
    """Write the whole paper, or nothing; HapticError says why not."""
    require_ending(path, ENDINGS)
    match path.suffix.lower():
        case ".pdf":
            # matplotlib is slow
            from haptic_driver.lab.papers.pdf import write_pdf  # noqa: PLC0415

            write_pdf(document, path)
        case ".html":
            write_text(path, page(document))
        case _:
            text = json.dumps(document.facts, indent=1, allow_nan=False, ensure_ascii=False)
            write_text(path, text + "\n")


def page(document: Document) -> str:
    """The paper as one page of HTML."""
    body = "\n".join(_html(block) for block in document.blocks)
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width">'
        f"<title>{_text(document.title)}</title><style>{STYLE}</style></head><body>\n"
        f'<h1>{_text(document.title)}</h1><p class="about">{_text(document.about)}</p>\n'
        f'{body}\n<p class="about">{_text(document.foot)}</p>\n</body></html>\n'
    )


def _html(block: Block) -> str:
    match block:
        case Heading(text):
            return f"<h2>{_text(text)}</h2>"
        case Paragraph(text, small):
            said = "<br>".join(_text(line) for line in text.split("\n"))
            return f"<p{' class=small' if small else ''}>{said}</p>"
        case Table():
            head = "".join(f"<th>{_text(cell)}</th>" for cell in block.header)
            whole = sum(block.widths)
            columns = "".join(
                f'<col style="width:{100 * share / whole:.1f}%">' for share in block.widths
            )
            style = f' style="height:{block.row_mm:g}mm"' if block.row_mm else ""
            rows = "\n".join(
                f"<tr{style}>{''.join(f'<td>{_text(cell)}</td>' for cell in row)}</tr>"
                for row in block.rows
            )
            return (
                f"<table><colgroup>{columns}</colgroup><thead><tr>{head}</tr></thead>"
                f"<tbody>\n{rows}\n</tbody></table>"
            )
        case Figure():
            return f"<figure>{_svg(block)}<figcaption>{_text(block.caption)}</figcaption></figure>"


def _text(text: str) -> str:
    return escape(shown(text, lines=True))


def _svg(figure: Figure) -> str:
    text = picture(figure, "svg").decode()
    return text[text.index("<svg") :]
