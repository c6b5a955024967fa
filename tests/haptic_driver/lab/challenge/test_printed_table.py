"""The printed table of `docs/diagnosis-results.md` comes out of the challenge's own rules."""

import re
from pathlib import Path

import numpy as np
import pytest

from haptic_driver.lab.challenge.answers import Answer
from haptic_driver.lab.challenge.own import VERDICTS
from haptic_driver.lab.challenge.scores import Truth, scores
from tests.blind.generator.effects import STRANGERS
from tests.haptic_driver.commands import rows_of

ROOT = Path(__file__).resolve().parents[4]
SURE = 0.95  # what the page says that boosted trees name at
NO_ROWS = np.zeros(0)
ROWS = {
    "visible single effects named": "single_named",
    "the same, right or in the list": "single_found",
    "pairs, both named": "pair_named",
    "pairs, both named or in the list": "pair_found",
    "of no catalogue and visible, left without a name (`unexplained`)": "outside_unknown",
    "of no catalogue, given a name": "outside_named",
    "nothing hidden, a name": "nothing_named",
    "nothing hidden, a name or a list": "nothing_named",
    "wrong names, of all sets": "wrong_name",
}


def table(header):
    """Rows of a printed table by their first cell; the others by the header's."""
    text = (ROOT / "docs" / "diagnosis-results.md").read_text(encoding="utf-8")
    block = next(part for part in text.split("\n\n") if part.startswith(header))
    cells = [[c.strip() for c in line.strip("|").split("|")] for line in block.splitlines()]
    return {row[0]: dict(zip(cells[0][1:], row[1:], strict=True)) for row in cells[2:]}


def printed(cell):
    """Count and number of sets in a cell."""
    return tuple(map(int, re.search(r"(\d+)/(\d+)", cell).groups())) if cell else None


@pytest.fixture(scope="module")
def answered():
    return rows_of(ROOT / "benchmarks" / "diagnosis.csv")


def truth_of(row):
    effects = frozenset(row["hidden"].split())
    visibility = min(map(float, row["lambda"].split()), default=0.0)
    return Truth(effects, not effects & set(STRANGERS), visibility, {}, NO_ROWS, NO_ROWS)


def by_diagnosis(row):
    names = [*row["named"].split(), *row["or"].split()]
    return Answer(verdict=VERDICTS[row["verdict"]], effects=names)


def by_one_name(column):
    def answer(row):
        probability = float(row.get(f"{column}_probability", 1.0))
        if row[column] == "none" or probability < SURE:
            return Answer(verdict="nothing")
        return Answer(verdict="named", effects=[row[column]])

    return answer


def scored(rows, answer):
    """Counts by key, of these rows."""
    answers = {row["set"]: answer(row) for row in rows}
    names = scores(answers, {row["set"]: truth_of(row) for row in rows})["names"]
    return {key: (rate["count"], rate["of"]) for key, rate in names.items()}


@pytest.mark.parametrize(
    ("witnesses", "column"), [("all", "all witnesses"), ("friction", "friction alone")]
)
def test_the_table_of_verdicts(answered, witnesses, column):
    rows = [row for row in answered if row["witnesses"] == witnesses]
    found = scored(rows, by_diagnosis)
    shown = {
        ROWS[said]: cells[column] for said, cells in table("| | all wit").items() if said in ROWS
    }
    assert {key: found[key] for key in shown} == {k: printed(cell) for k, cell in shown.items()}
    assert len(shown) == 8


@pytest.mark.parametrize(
    ("column", "answer"),
    [
        ("diagnosis", by_diagnosis),
        ("AICc", by_one_name("aicc")),
        ("BIC", by_one_name("bic")),
        ("boosted trees", by_one_name("boosted_trees")),
    ],
)
def test_the_table_of_other_methods(answered, column, answer):
    found = scored([row for row in answered if row["witnesses"] == "all"], answer)
    shown = {ROWS[said]: cells[column] for said, cells in table("| all witn").items()}
    expected = {key: printed(cell) for key, cell in shown.items() if cell}
    assert {key: found[key] for key in expected} == expected
    assert len(expected) >= 5
