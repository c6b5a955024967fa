"""The page on force over voltage says what the models say, and they begin with the square."""

from __future__ import annotations

from pathlib import Path

import pytest

from haptic_driver.lookup.models import load_model
from model.analysis.voltage_law import beyond_published, exponent
from model.touch_model import TouchModel
from validation import voltage

DOCS = Path(__file__).parents[1] / "docs"


def test_the_page_is_what_the_command_writes(tmp_path):
    (tmp_path / "pictures").mkdir()
    assert voltage.write(tmp_path).read_text() == (DOCS / "voltage-law.md").read_text()
    assert (tmp_path / "pictures" / "voltage-law.png").stat().st_size > 10_000


def test_a_skin_that_does_not_yield_has_the_exponent_two():
    stiff = voltage.changed(load_model("reference"), "skin_modulus_pa", 100.0)
    found = voltage.growth(stiff, 0.5)
    assert found.exponent == pytest.approx(2.0, abs=0.02)
    assert found.ratio == pytest.approx(1.0, abs=0.02)


def test_where_a_model_is_steeper_than_published_fingers_it_says_so():
    reference = TouchModel(load_model("reference"))
    stiff = TouchModel(voltage.changed(load_model("reference"), "skin_modulus_pa", 100.0))
    said = beyond_published(reference, 125.0, 150.0, 0.5)
    assert said is not None
    assert "150 V and 0.5 N" in said
    assert beyond_published(reference, 125.0, 70.0, 0.5) is None
    assert beyond_published(stiff, 125.0, 150.0, 0.5) is None
    between = voltage.growth(load_model("reference"), 0.5).exponent  # from 75 to 150 V
    ends = [exponent(reference, 125.0, v, 0.5) for v in (75.0, 150.0)]
    assert ends[0] < between < ends[1]
