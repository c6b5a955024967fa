"""The page on force over voltage says what the models say, and they begin with the square."""

from __future__ import annotations

import json
import math
from pathlib import Path

import pytest

from haptic_driver.lookup.models import load_model
from model.analysis.voltage_law import beyond_published, exponent
from model.touch_model import TouchModel
from validation import voltage

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"


def test_the_page_is_what_the_command_writes(tmp_path):
    (tmp_path / "pictures").mkdir()
    assert voltage.write(tmp_path).read_text() == (DOCS / "voltage-law.md").read_text()
    assert (tmp_path / "pictures" / "voltage-law.png").stat().st_size > 10_000


def test_a_skin_that_does_not_yield_has_the_exponent_two():
    stiff = voltage.changed(load_model("reference"), "skin_modulus_pa", 100.0)
    found = voltage.growth(stiff, 0.5)
    assert found.exponent == pytest.approx(2.0, abs=0.02)
    assert found.ratio == pytest.approx(1.0, abs=0.02)


def test_the_exponent_is_that_of_an_independent_solution():
    independent = json.loads((ROOT / "tests" / "model" / "reference.json").read_text())
    points = independent["reference"]["points"]
    names = ("frequency_hz", "voltage_v", "normal_force_n")
    touches = zip(*(points[name] for name in names), strict=True)
    force_n = dict(zip(touches, points["electrostatic_force_n"], strict=True))
    grown = force_n[100.0, 125.0, 0.5] / force_n[100.0, 75.0, 0.5]
    reference = TouchModel(load_model("reference"))
    # forces agree to 0.2 %
    expected = math.log(grown) / math.log(125.0 / 75.0)
    assert exponent(reference, 100.0, 125.0, 0.5) == pytest.approx(expected, abs=0.01)


def test_where_a_model_is_steeper_than_published_fingers_it_says_so():
    reference = TouchModel(load_model("reference"))
    stiff = TouchModel(voltage.changed(load_model("reference"), "skin_modulus_pa", 100.0))
    said = beyond_published(reference, 125.0, 150.0, 0.5)
    assert said is not None
    assert said.startswith("above 75 V the model 'reference' is steeper than published fingers")
    assert "the power 2.9 up to 150 V at 0.5 N" in said
    for at_most_v in (70.0, 75.0):
        assert beyond_published(reference, 125.0, at_most_v, 0.5) is None
    assert beyond_published(stiff, 125.0, 150.0, 0.5) is None
