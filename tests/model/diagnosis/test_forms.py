"""What the share of a gap that an effect closes says of the effect."""

from __future__ import annotations

import numpy as np
import pytest

from model.diagnosis import forms
from model.diagnosis.forms import FILE, Row, Share, catalogue_hash, share_odds

NAN = float("nan")


def test_the_file_is_of_this_catalogue():
    assert FILE.read_text().splitlines()[0].endswith(catalogue_hash()), "run: make forms"


def test_odds_by_hand_leave_the_effect_in_question_out(monkeypatch):
    """More than all of a gap is all of it; a share of no gap is none."""
    made = [
        Row("floating_body", "second", 0.2),
        *(Row("sweat_film", form, closed) for form, closed in (("first", 0.9), ("second", 1.4))),
        *(Row(stranger, "catalogue", c) for stranger, c in (("x", 0.1), ("y", 0.3), ("z", NAN))),
    ]
    monkeypatch.setattr(forms, "rows_of_file", lambda: made)
    width = 0.05 * 2**-0.2
    there = np.mean(np.exp(-0.5 * (np.array([0.1, 0.0]) / width) ** 2)) / width
    width = 0.1 * 2**-0.2
    strange = np.mean(np.exp(-0.5 * (np.array([0.9, 0.7]) / width) ** 2)) / width
    assert share_odds([Share("floating_body", 1.7, 0.0)]) == pytest.approx(there / strange)


def test_who_closes_most_of_a_gap_is_likelier_there_and_who_closes_little_is_not():
    assert share_odds([Share("", 1.0, 0.05)]) > 2.0
    assert share_odds([Share("", 0.1, 0.05)]) < 0.5
    both = [Share("", 1.0, 0.05), Share("", 0.1, 0.05)]
    assert share_odds(both) == pytest.approx(np.prod([share_odds([one]) for one in both]))


@pytest.mark.parametrize("share", [Share("", NAN, 0.1), Share("", 0.9, NAN), Share("", 0.9, 1e3)])
def test_a_share_that_nobody_knows_says_nothing(share):
    assert share_odds([share]) == pytest.approx(1.0, abs=1e-3)
