"""What plain English means here, as far as a program can tell: short sentences, known words.

`sentences_of` takes prose out of Markdown and docstrings: no code, no tables, no headings. A
sentence may have 25 words; inline code counts as one.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[2]
PAGES = (*sorted((ROOT / "docs").glob("*.md")), ROOT / "README.md", ROOT / "CONTRIBUTING.md")
PACKAGES = ("haptic_driver", "model", "hw")
LONGEST_WORDS = 25
NOT_OURS = (
    r"form off",
    r"bent",
    r"held tight",
    r"rivals?",
    r"strangers?",
    r"kin",
    r"vouch\w*",
    r"mended?",
    r"mending",
    r"as felt",
    r"says \d+ nats",
    r"a word",
)
_END = re.compile(r"(?<=[.!?])\s+")


class Sentence(NamedTuple):
    """A sentence, and the page or module that it stands in, below the root."""

    where: str
    text: str

    @property
    def words(self) -> int:
        return len(re.findall(r"[\w°%µ./'-]+", self.text))


def of_pages() -> Iterator[Sentence]:
    """Every sentence of the pages."""
    for path in PAGES:
        where = path.relative_to(ROOT).as_posix()
        yield from sentences_of(path.read_text(encoding="utf-8"), where)


def of_docstrings() -> Iterator[Sentence]:
    """Every sentence of the docstrings of what is shipped."""
    for package in PACKAGES:
        for path in sorted((ROOT / package).rglob("*.py")):
            where = path.relative_to(ROOT).as_posix()
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef):
                    yield from sentences_of(ast.get_docstring(node) or "", where)


def sentences_of(text: str, where: str) -> Iterator[Sentence]:
    """The sentences of a text in Markdown."""
    text = re.sub(r"```.*?```|<!--.*?-->", "", text, flags=re.DOTALL)
    for paragraph in re.split(r"\n\s*\n", text):
        for part in _parts(paragraph):
            plain = re.sub(r"`[^`]*`", "X", re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", part))
            yield from (Sentence(where, s) for s in _END.split(plain) if s.strip())


def _parts(paragraph: str) -> list[str]:
    """A paragraph, or the items of a list, each as one line; without tables and headings."""
    parts: list[str] = []
    for line in paragraph.splitlines():
        if re.match(r"\s*[|#!]|    ", line):
            continue
        item = re.match(r"\s*(?:[-*]|\d+\.)\s+(.*)", line)
        if item or not parts:
            parts.append(item[1] if item else line.strip())
        else:
            parts[-1] += " " + line.strip()
    return parts
