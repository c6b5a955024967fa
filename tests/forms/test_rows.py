"""The file of forms is what the command makes today."""

from __future__ import annotations

import pytest

from model.diagnosis.forms import rows_of_file
from tests.blind.generator.effects import CATALOGUE, SECOND
from tests.forms.__main__ import ALL, row


def test_every_form_and_stranger_has_a_row():
    assert [(one.name, one.form) for one in rows_of_file()] == ALL


@pytest.mark.soak
@pytest.mark.parametrize(
    "what", [("series_resistance", SECOND), ("monitor_roll_off", CATALOGUE)], ids=lambda w: w[0]
)
def test_a_row_is_made_again(what):
    """To the digits of the file; other processors round otherwise."""
    kept = next(one for one in rows_of_file() if (one.name, one.form) == what)
    assert row(what).closed == pytest.approx(kept.closed, abs=5e-3)
