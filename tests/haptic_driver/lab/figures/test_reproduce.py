"""The numbers of figures 4-8 and the facts of the paper's text beside them."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from haptic_driver.lab.figures import facts, numbers
from model.published import as_published
from model.support.errors import ModelError
from model.touch_model import TouchModel

FINGERS = ("reference", "table1")
PAGE = Path(__file__).parents[4] / "docs" / "reproduction.md"


@pytest.fixture(scope="module")
def pair(models, fresh_tables):
    """Corrected and published, by finger."""
    found = {name: numbers.variants(models[name].description) for name in FINGERS}
    for each in found.values():
        for model in each.values():
            fresh_tables(model)
    return found


@pytest.fixture(scope="module")
def solved(pair):
    return numbers.against_frequency(pair["reference"])


@pytest.fixture(scope="module")
def sensitivities(pair):
    return {name: numbers.sensitivities(model) for name, model in pair["reference"].items()}


def at_paper_hz(column):
    return column[np.isin(numbers.SWEEP_HZ, numbers.PAPER_HZ)]


@pytest.mark.parametrize("name", FINGERS)
def test_fig_4_has_the_reference_pressures(pair, reference, name):
    """Every reference point at the paper's load whose voltage and frequency Fig. 4 has."""
    found, points = numbers.against_voltage(pair[name])["corrected"], reference[name]["points"]
    checked = 0
    for f, v, n, force in zip(
        points["frequency_hz"],
        points["voltage_v"],
        points["normal_force_n"],
        points["electrostatic_force_n"],
        strict=True,
    ):
        i, j = np.flatnonzero(f == numbers.PAPER_HZ), np.flatnonzero(v == numbers.VOLTAGES_V)
        if n == 0.5 and i.size and j.size:
            assert found.pressure_pa[i[0], j[0]] * 1e-4 == pytest.approx(force, rel=2e-3)
            checked += 1
    assert checked >= 40


def test_fig_7_is_the_key_result(solved, reference):
    key = reference["key_table"]
    np.testing.assert_array_equal(numbers.PAPER_HZ, key["frequency_hz"])
    got = at_paper_hz(solved["corrected"].force_n) * 1e3
    np.testing.assert_allclose(got, key["electrostatic_force_mn"], atol=0.051)  # printed to 0.1 mN


def test_printed_force_is_pressure_times_real_area(solved):
    """(30) as printed: what is drawn as pressure in Fig. 4 and as force in Fig. 7 belong
    together.
    """
    found = solved["published"]
    np.testing.assert_allclose(
        found.force_n, found.pressure_pa * 1e-4 * found.area_ratio, rtol=1e-9
    )


class TestSensitivity:
    def test_only_thickness_over_permittivity_of_the_insulator_counts(self, sensitivities):
        s = sensitivities["corrected"]
        np.testing.assert_allclose(
            s["insulator_thickness_m"].elasticity,
            -s["insulator_permittivity"].elasticity,
            rtol=1e-3,
        )

    def test_forces_are_those_of_a_model_with_the_parameter_changed(
        self, sensitivities, models, fresh_tables
    ):
        given = models["reference"].description
        for name, s in sensitivities["corrected"].items():
            p = given.parameters
            half = replace(
                given, parameters={**p, name: replace(p[name], value=0.5 * p[name].value)}
            )
            got = numbers.touching(fresh_tables(TouchModel(half)), numbers.PAPER_HZ).force_n
            np.testing.assert_allclose(s.lower_n, got, rtol=1e-12)
            np.testing.assert_allclose(
                s.lower_percent, 100.0 * (got / s.nominal_n - 1.0), rtol=1e-9, atol=1e-9
            )


@pytest.fixture(scope="module")
def stated(pair, solved, sensitivities):
    models = pair["reference"]
    dielectric = models["corrected"].description.dielectric
    return [
        *facts.of_step(numbers.charges_after_step(models)),
        *facts.of_steady_charges(numbers.steady_charges(models)),
        *facts.of_force(solved, dielectric, models["corrected"].description.values.cof_off),
        *facts.of_sensitivity(sensitivities),
    ]


def test_the_page_says_the_same(stated):
    """docs/reproduction.md, its table: every statement, number and verdict."""
    rows = [
        [cell.strip() for cell in line.strip().strip("|").split(" | ")]
        for line in PAGE.read_text(encoding="utf-8").splitlines()
        if re.match(r"\| \d", line)
    ]
    assert [row[1] for row in rows] == [f.statement for f in stated]
    for row, fact in zip(rows, stated, strict=True):
        answers = ((fact.corrected, fact.corrected_holds), (fact.published, fact.published_holds))
        for cell, (value, holds) in zip(row[3:], answers, strict=True):
            if np.isnan(value):
                assert cell == "-"
                continue
            number, verdict = cell.split(", ")
            assert float(number) == pytest.approx(value, rel=1e-2)
            assert verdict == ("yes" if holds else "**no**")


def test_a_model_that_cannot_stand_beside_the_print_is_refused(models):
    with pytest.raises(ModelError, match="not the plain corrected model") as caught:
        numbers.variants(as_published(models["table1"].description))
    assert "reference" in caught.value.hint
