"""What other forms say of an effect's form, and of the share of a gap that it closes."""

from __future__ import annotations

import numpy as np
import pytest

from model.diagnosis import forms
from model.diagnosis.forms import EXACT, FILE, Row, Share, catalogue_hash, form_errors, share_odds

NAN = float("nan")
MADE = [
    Row("a", "second", EXACT, 0.0, 0.9),
    *(Row("b", "second", "apart", share, 1.0) for share in (0.1, 0.2)),
    *(Row("c", "second", "together", share, 0.8) for share in (0.4, 1.4)),
    Row("stranger", "catalogue", "", 0.0, 0.1),
    Row("other stranger", "catalogue", "", 0.0, 0.3),
]


@pytest.fixture
def made(monkeypatch):
    monkeypatch.setattr(forms, "rows_of_file", lambda: MADE)
    forms._form_errors.cache_clear()
    yield
    forms._form_errors.cache_clear()


def test_the_file_is_of_this_catalogue():
    assert FILE.read_text().splitlines()[0].endswith(catalogue_hash()), "run: make forms"


@pytest.mark.usefixtures("made")
def test_shares_are_those_of_other_effects():
    """Five values stand for what lies between the two shares of each way."""
    every, without = form_errors([]), form_errors(["a", "d"])
    assert every.exact == pytest.approx(2 / 7)  # one of five, and one more of each kind
    assert without.exact == pytest.approx(1 / 6)
    assert every.shares[0] == pytest.approx([0.11, 0.13, 0.15, 0.17, 0.19])
    assert every.shares[1] == pytest.approx([0.5, 0.7, 0.9, 1.1, 1.3])


@pytest.mark.usefixtures("made")
def test_odds_of_a_share_by_hand():
    """One more than all of a gap is all of it."""
    width = np.std([0.9, 1.0, 1.0]) * 3**-0.2
    there = np.mean(np.exp(-0.5 * (np.array([0.1, 0.0, 0.0]) / width) ** 2)) / width
    width = 0.1 * 2**-0.2
    strange = np.mean(np.exp(-0.5 * (np.array([0.9, 0.7]) / width) ** 2)) / width
    assert share_odds([Share("c", 1.7, 0.0)]) == pytest.approx(there / strange)


def test_who_closes_most_of_a_gap_is_likelier_there_and_who_closes_little_is_not():
    assert share_odds([Share("", 1.0, 0.05)]) > 2.0
    assert share_odds([Share("", 0.1, 0.05)]) < 0.5
    both = [Share("", 1.0, 0.05), Share("", 0.1, 0.05)]
    assert share_odds(both) == pytest.approx(np.prod([share_odds([one]) for one in both]))


@pytest.mark.parametrize("share", [Share("", NAN, 0.1), Share("", 0.9, NAN), Share("", 0.9, 1e3)])
def test_a_share_that_nobody_knows_says_nothing(share):
    assert share_odds([share]) == pytest.approx(1.0, abs=1e-3)
