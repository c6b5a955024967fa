"""The page about the verdict: its numbers are those of the program, its figure is drawn by it."""

from __future__ import annotations

import importlib
import re
import sys
from collections.abc import Sequence
from pathlib import Path

import pytest

from model.diagnosis.forms import Share, share_odds
from model.diagnosis.hidden import NO_TRACE
from model.diagnosis.priors import (
    AMPLITUDES,
    EXACT,
    FORM_ERRORS,
    PRIOR_EFFECTS,
    PRIOR_NONE,
    PRIOR_UNKNOWN,
    SURE,
)
from model.effects import CATALOGUE
from model.planning.separation import ALIKE, APART

DOCS = Path(__file__).resolve().parents[2] / "docs"
PAGE = (DOCS / "verdict.md").read_text(encoding="utf-8")
sys.path.insert(0, str(DOCS))
figure = importlib.import_module("verdict_figure")


def percents(shares: Sequence[float]) -> str:
    """As the page lists them."""
    return ", ".join(f"{100.0 * share:g}" for share in shares) + " %"


def rows() -> dict[str, str]:
    """First cell to second of every row of every table."""
    return dict(re.findall(r"^\| ([^|]+) \| ([^|]+) \|", PAGE, flags=re.MULTILINE))


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("`none`", f"{PRIOR_NONE:g}"),
        ("`unknown`", f"{PRIOR_UNKNOWN:g}"),
        ("each effect", f"{PRIOR_EFFECTS:g} / {len(CATALOGUE)}"),
        ("exact form", f"{EXACT:g}"),
        ("inexact form, each witness", f"{percents(FORM_ERRORS[0])} of the signature"),
        ("inexact form, all together", f"{percents(FORM_ERRORS[1])} of the strength"),
        ("discrepancy", percents(AMPLITUDES)),
        ("no trace", f"*lambda* below {NO_TRACE:g}"),
        ("SURE", f"{SURE:g}"),
        ("ALIKE", f"{ALIKE:.1f}"),
        ("APART", f"{APART:.1f}"),
    ],
)
def test_the_table_has_the_numbers_of_the_program(name, value):
    assert rows()[name] == value


def test_the_odds_against_something_unknown_are_said():
    assert f"by {(1.0 - PRIOR_UNKNOWN) / PRIOR_UNKNOWN:.1f} or more" in PAGE


def test_the_odds_of_shares_are_said():
    said = rows_of("share of the gap closed, known within 0.05"), rows_of("odds")
    for share, odds in zip(*said, strict=True):
        found = share_odds([Share("", float(share), 0.05)])
        assert float(odds) == pytest.approx(found, rel=0.02)


def rows_of(first: str) -> list[str]:
    """All other cells of the row that begins so."""
    line = next(line for line in PAGE.splitlines() if line.startswith(f"| {first} |"))
    return line.strip("| ").split(" | ")[1:]


def test_the_threshold_of_a_plan_is_said():
    how_to = (DOCS / "diagnosis.md").read_text(encoding="utf-8")
    assert re.search(rf"\*lambda\*\s+of \[{APART:.1f}\]\(verdict.md#planning\)", how_to)


def test_the_figure_is_up_to_date(tmp_path):
    """Its texts, which hold every name and number; how they are drawn is matplotlib's."""
    figure.write(tmp_path / "verdict.svg")
    today, kept = (
        re.findall(r"<!-- (.+?) -->", path.read_text(encoding="utf-8"))
        for path in (tmp_path / "verdict.svg", DOCS / "pictures" / "verdict.svg")
    )
    assert "load dependent friction with drive gain error" in today
    assert kept == today, "run: python docs/verdict_figure.py"
