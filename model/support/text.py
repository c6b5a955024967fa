"""Texts as people save columns: their letters, their cells, and numbers with points or commas."""

from __future__ import annotations

import codecs
import csv
import io
import re
import unicodedata
from collections.abc import Sequence
from datetime import datetime
from math import nan
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from model.support.cells import is_number, number
from model.support.errors import ModelError
from model.support.reading import as_text, not_text

Decimal = Literal[".", ","]
BINARY = re.compile(rb"[\x00-\x08\x0e-\x1f]")
SEPARATORS = {";": ";", "tab": "\t", ",": ",", "space": " "}
BOMS = {
    codecs.BOM_UTF8: "utf-8-sig",
    codecs.BOM_UTF32_LE: "utf-32",
    codecs.BOM_UTF32_BE: "utf-32",
    codecs.BOM_UTF16_LE: "utf-16",
    codecs.BOM_UTF16_BE: "utf-16",
}
THOUSANDS = {mark: re.compile(rf"[-+]?[1-9]\d{{0,2}}(?:\{mark}\d{{3}})+") for mark in ".,"}
APOSTROPHE = re.compile(r"(?<=\d)['\u2019](?=\d{3})")  # Swiss thousands
MINUS = "\u2212"
COMMA = re.compile(r"[-+]?\d*,\d+([eE][-+]?\d+)?")


class Line(NamedTuple):
    """A record of a text: the line of the file where it ends, and its cells."""

    number: int
    cells: list[str]


def decoded(path: Path, content: bytes, encoding: str | None = None) -> str:
    """The letters of a text by its byte order mark, or `encoding`, or UTF-8, or Windows' own.

    ModelError for a binary file and for an encoding that does not hold.
    """
    found = next((name for mark, name in BOMS.items() if content.startswith(mark)), encoding)
    if found is None and b"\0" in content:
        found = _wide(content)
    try:
        text = content.decode(found) if found else as_text(path, content)
    except (UnicodeDecodeError, LookupError) as error:
        said = f"{path} is not text in {found} ({error})"
        raise ModelError(said, "Give file.encoding as it was saved", "file_unreadable") from error
    except ModelError:
        if BINARY.search(content[:1000]):
            raise
        return content.decode("cp1252", errors="replace")
    if found and _is_noise(text[:1000]):
        raise not_text(path)
    return text


def _is_noise(letters: str) -> bool:
    """Whether letters of two bytes or more are those of no table.

    Its numbers and ends of lines are ASCII, and no letter is unassigned, private or a control.
    """
    controls = {"Cc", "Cn", "Co", "Cs"}
    odd = (c not in "\t\r\n\f" and unicodedata.category(c) in controls for c in letters)
    return any(odd) or (bool(letters) and not any(map(str.isascii, letters)))


def _wide(content: bytes) -> str | None:
    """UTF-16 without its mark: every other byte of its letters is 0."""
    sample = content[:1000]
    for name, zeros in (("utf-16-le", sample[1::2]), ("utf-16-be", sample[::2])):
        if zeros.count(0) > 0.9 * len(zeros) > 0:
            return name
    return None


def split(path: Path, text: str, separator: str) -> list[Line]:
    """The records of a text, cells without the blanks around them; ModelError for a bad quote."""
    mark = SEPARATORS.get(separator, separator)
    lines = io.StringIO(text, newline="")
    reader = csv.reader(lines, delimiter=mark, skipinitialspace=True, strict=True)
    try:
        return [Line(reader.line_num, [" ".join(cell.split()) for cell in row]) for row in reader]
    except csv.Error as error:
        said = f"{path}, line {reader.line_num}: is not CSV ({error})"
        raise ModelError(said, "Is a quote left open there?", "bad_table") from None


def numbers(
    where: str, cells: Sequence[str], decimal: Decimal | None = None
) -> NDArray[np.float64]:
    """Cells [n] as numbers, NaN for empty ones and those that are none.

    A comma is a decimal sign or one of thousands, as the whole column tells. ModelError where the
    column can be either, unless `decimal` says it.
    """
    try:
        return np.array([number(cell) for cell in plain(where, cells, decimal)])
    except ValueError:
        return np.array([_or_nan(cell) for cell in plain(where, cells, decimal)])


def plain(where: str, cells: Sequence[str], decimal: Decimal | None = None) -> Sequence[str]:
    """Cells with points alone, as Python writes numbers; ModelError as `numbers` has it."""
    cells = [APOSTROPHE.sub("", cell.replace(MINUS, "-")) for cell in cells]
    commas = [cell for cell in cells if "," in cell]
    points = [cell for cell in cells if "." in cell]
    both = next((cell for cell in commas if "." in cell), None)
    if both is not None:
        thousands = "," if both.rfind(".") > both.rfind(",") else "."
        return [cell.replace(thousands, "").replace(",", ".") for cell in cells]
    if not commas:
        if decimal == "," and points and _all_thousands(points, "."):
            raise _either(where, points[0])
        return cells
    if not _all_thousands(commas, ","):
        return cells if decimal == "." else [cell.replace(",", ".") for cell in cells]
    if decimal is None and (not points or _all_thousands(points, ".")):
        raise _either(where, commas[0])
    return [cell.replace(",", "." if decimal == "," else "") for cell in cells]


def _all_thousands(cells: Sequence[str], mark: str) -> bool:
    return all(THOUSANDS[mark].fullmatch(cell) for cell in cells)


def _either(where: str, cell: str) -> ModelError:
    whole = re.sub(r"[.,]", "", cell)
    said = f"{where}: '{cell}' can be {whole} or {cell.replace(',', '.')}"
    return ModelError(said, "Say which sign is the decimal one", "ambiguous_number")


def _or_nan(cell: str) -> float:
    return number(cell) if is_number(cell) else nan


def times(cells: Sequence[str]) -> NDArray[np.float64] | None:
    """Cells [n] that are dates or times of day, in s from the first; None where one is neither."""
    try:
        stamps = [_stamp(cell) for cell in cells]
    except ValueError:
        return None
    passed = np.array([(stamp - stamps[0]).total_seconds() for stamp in stamps])
    at_midnight = np.diff(passed, prepend=0.0) < -12 * 3600.0
    return np.asarray(passed + 86400.0 * np.cumsum(at_midnight))


def _stamp(cell: str) -> datetime:
    hour = re.match(r"\d{1,2}(?=:\d{2})", cell)
    if hour is not None:
        cell = f"2000-01-01T{'0' * (2 - len(hour[0]))}{cell}"
    return datetime.fromisoformat(cell.replace(",", ".").replace("/", "-"))


def is_value(cell: str) -> bool:
    """Whether a cell is a number with a point or comma, or a date or time."""
    return is_number(cell) or bool(COMMA.fullmatch(cell)) or times([cell]) is not None
