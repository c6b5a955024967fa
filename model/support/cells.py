"""Cells of a CSV that no spreadsheet runs."""

from __future__ import annotations

from collections.abc import Iterable

FORMULAS = (
    "=",
    "+",
    "-",
    "@",
    "\t",
    "\r",
    "\n",
    "＝",
    "＋",
    "－",
    "＠",
)  # what a spreadsheet takes for one, or trims


def written_cell(value: object) -> object:
    """A value as a CSV has it: text that a spreadsheet would run as a formula gets a ' before it; a
    number does not.
    """
    return (
        f"'{value}"
        if isinstance(value, str) and _is_formula(value) and not is_number(value)
        else value
    )


def read_cell(text: str) -> str:
    """What `written_cell` was given as text."""
    return text[1:] if text.startswith("'") and _is_formula(text) else text


def written_cells(values: Iterable[object]) -> list[object]:
    """A line of them."""
    return [written_cell(value) for value in values]


def number(text: str) -> float:
    """The number that a text is; ValueError where it is none, as 1_25, which Python would take."""
    if "_" in text:
        raise ValueError(f"{text!r} is no number")
    return float(text)


def _is_formula(text: str) -> bool:
    return text.lstrip("'").startswith(FORMULAS)


def is_number(text: str) -> bool:
    """Whether `number` takes it."""
    try:
        number(text)
    except ValueError:
        return False
    return True
