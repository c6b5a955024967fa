"""Five fixed blind sets: what the diagnosis may and may not say. With `make soak`; `make blind` has
any number.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.blind.evaluate import Answer, run
from tests.blind.scores import CLEAR, hidden
from tests.blind.sets_csv import write_csv
from tests.haptic_driver.commands import rows_of

ROOT = Path(__file__).resolve().parents[2]
pytestmark = pytest.mark.soak


@pytest.fixture(scope="module")
def outcome(tmp_path_factory):
    """Answers of the workflow, and only then the labels."""
    folder = tmp_path_factory.mktemp("blind")
    command = [
        sys.executable,
        "-m",
        "tests.blind.generator",
        "--ci",
        "--out",
        str(folder),
        "--workers",
        "2",
    ]
    subprocess.run(
        command, cwd=ROOT, check=True, capture_output=True, timeout=280, env=dict(os.environ)
    )
    answers = run(folder, 2)
    return answers, json.loads((folder / "labels.json").read_text())


def pick(outcome, wanted) -> list[tuple[dict, Answer]]:
    answers, labels = outcome
    return [(labels[name], got) for name, got in answers.items() if wanted(labels[name])]


@pytest.mark.timeout(600)
def test_no_set_fails(outcome):
    answers, _ = outcome
    assert len(answers) == 5
    assert [got.error for got in answers.values() if got.error] == []


def test_nothing_hidden_is_never_given_a_name(outcome):
    """A list may be given where `none` has half of the probability: it says so."""
    null = pick(outcome, lambda label: not label["effects"])
    assert len(null) == 2
    assert [got.names for _, got in null if got.verdict == "effect_found"] == []


def test_a_clearly_visible_effect_is_found_or_its_group(outcome):
    clear = pick(
        outcome,
        lambda label: (
            len(label["effects"]) == 1
            and not label["effects"][0]["stranger"]
            and label["effects"][0]["lambda"] >= CLEAR
        ),
    )
    assert len(clear) == 2
    missed = [
        (hidden(label), got) for label, got in clear if not hidden(label) & {*got.names, *got.group}
    ]
    assert missed == []


def test_no_wrong_name_is_given(outcome):
    wrong = [
        (hidden(label), got.names)
        for label, got in pick(outcome, lambda _: True)
        if got.verdict == "effect_found" and not hidden(label) & set(got.names)
    ]
    assert wrong == []


def test_strangers_are_unexplained(outcome):
    strangers = pick(outcome, lambda label: any(effect["stranger"] for effect in label["effects"]))
    assert len(strangers) == 1
    assert {got.verdict for _, got in strangers} == {"unexplained"}


def test_every_set_has_a_row_with_what_was_hidden_and_said(outcome, tmp_path):
    answers, labels = outcome
    write_csv(tmp_path / "sets.csv", answers, labels, {})
    rows = rows_of(tmp_path / "sets.csv")
    assert [row["set"] for row in rows] == sorted(answers)
    for row in rows:
        effects = labels[row["set"]]["effects"]
        assert row["hidden"].split() == [effect["name"] for effect in effects]
        assert row["verdict"] == answers[row["set"]].verdict
