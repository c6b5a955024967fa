"""The effect `learned`: what its forms say, where they end, and their table in a model file."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from model.conditions import sines
from model.description import ModelDescription, read_model
from model.effects import BY_NAME, CATALOGUE
from model.effects.learned import (
    LEARNED,
    QUANTITIES,
    LearnedForm,
    Term,
    learned_kind,
    spline_weights,
)
from model.learned_file import form_lines
from model.support.errors import ModelError
from model.touch_model import TouchModel
from tests.fingers import SHIPPED

FREQUENCIES = (10.0, 100.0, 250.0, 1e4)
SPEEDS = (0.01, 0.02, 0.05)
OVER_FREQUENCY = LearnedForm(
    "friction", "spline", (Term(("frequency_hz",), (FREQUENCIES,), 0.1),), 40.0
)
PAIR = LearnedForm(
    "gap_field",
    "spline",
    (Term(("frequency_hz", "speed_m_s"), (FREQUENCIES, SPEEDS)), Term(("time_s",), ((0.0, 9.0),))),
    40.0,
)


def learned(form: LearnedForm, *values: float):
    return learned_kind(form)(*values)


def model_with(tmp_path: Path, form: LearnedForm, *values: float) -> ModelDescription:
    names = [p.name for p in learned_kind(form).parameters()]
    table = "\n".join(
        [
            f"[effects.{LEARNED}]",
            *form_lines(form),
            *(f"{n} = {v}" for n, v in zip(names, values, strict=True)),
        ]
    )
    path = tmp_path / "learned.toml"
    path.write_text(f"{SHIPPED}\n{table}\n", encoding="utf-8")
    return read_model(path)


def friction_factor(
    description: ModelDescription, plain: TouchModel, f: float, v: float, speed: float = 0.02
) -> float:
    drive = sines(np.array([f]), np.array([v]), np.array([0.5]), speed, 0.0)
    return float(TouchModel(description).answer(drive).cof[0] / plain.answer(drive).cof[0])


@pytest.mark.parametrize("nodes", [(0.0, 2.0), (0.0, 1.0, 4.0), (-1.0, 0.5, 0.7, 3.0, 8.0)])
def test_splines_are_scipys_natural_ones(nodes):
    values = np.random.default_rng(1).standard_normal(len(nodes))
    x = np.linspace(nodes[0], nodes[-1], 57)
    theirs = (
        CubicSpline(nodes, values, bc_type="natural")(x)
        if len(nodes) > 2
        else np.interp(x, nodes, values)
    )
    assert spline_weights(x, np.array(nodes)) @ values == pytest.approx(theirs, abs=1e-12)


def test_it_is_no_candidate_and_has_no_physical_name():
    assert LEARNED not in BY_NAME
    assert LEARNED not in {kind.name for kind in CATALOGUE}
    assert learned_kind(PAIR).name == "learned"
    assert learned_kind(PAIR).needs == ("speed_m_s", "time_s")
    assert learned_kind(PAIR).stage == "air gap"


@pytest.mark.parametrize("acts_on", QUANTITIES)
def test_with_every_value_zero_the_base_model_comes_back(acts_on, models, with_effects):
    phase = QUANTITIES[acts_on].has_phase
    form = LearnedForm(acts_on, "spline", (Term(("time_s",), ((0.0, 9.0),)),), 40.0, phase)
    drive = sines(np.array([30.0, 1e4]), np.array([80.0]), np.array([0.5]), 0.02, 3.0)
    ours = with_effects(learned_kind(form).off()).answer(drive)
    base = models["reference"].answer(drive)
    assert ours.cof == pytest.approx(base.cof, rel=1e-12)
    assert ours.electrode_current_a == pytest.approx(base.electrode_current_a, rel=1e-12)


def test_friction_is_multiplied_by_the_values_at_the_nodes(tmp_path, models):
    found = model_with(tmp_path, OVER_FREQUENCY, 0.1, -0.2, 0.3, 0.05)
    factors = [friction_factor(found, models["reference"], f, 80.0) for f in FREQUENCIES]
    assert np.log(factors) == pytest.approx([0.1, -0.2, 0.3, 0.05], abs=1e-12)


def test_without_voltage_there_is_no_frequency_and_little_of_it_at_little_voltage(tmp_path, models):
    found = model_with(tmp_path, OVER_FREQUENCY, 0.4, 0.4, 0.4, 0.4)
    factors = [
        friction_factor(found, models["reference"], 100.0, v) for v in (0.0, 20.0, 40.0, 80.0)
    ]
    assert np.log(factors) == pytest.approx([0.0, 0.1, 0.4, 0.4], abs=1e-12)


def test_beyond_its_range_it_stays_as_at_the_nearest_end(tmp_path, models):
    form = replace(OVER_FREQUENCY, terms=(Term(("speed_m_s",), (SPEEDS,)),))
    found = model_with(tmp_path, form, 0.1, 0.0, -0.3)
    assert np.log(friction_factor(found, models["reference"], 100.0, 80.0, 1.0)) == pytest.approx(
        -0.3, abs=1e-12
    )
    assert np.log(friction_factor(found, models["reference"], 100.0, 80.0, 0.001)) == pytest.approx(
        0.1, abs=1e-12
    )


@pytest.mark.parametrize(
    ("shape", "values", "at", "wanted"),
    [
        ("power", [0.5], 0.04, 0.5 * np.log(0.04 / np.sqrt(0.01 * 0.05))),
        ("saturation", [0.6, 0.02], 0.04, 0.6 * 0.04 / (0.04 + 0.02)),
        ("step", [0.6, 0.02, 3.0], 0.04, 0.6 / (1.0 + 0.5**3)),
    ],
)
def test_short_formulas(tmp_path, models, shape, values, at, wanted):
    form = LearnedForm("friction", shape, (Term(("speed_m_s",), ((0.01, 0.05),)),), 40.0)
    found = model_with(tmp_path, form, *values)
    assert np.log(friction_factor(found, models["reference"], 100.0, 80.0, at)) == pytest.approx(
        wanted, abs=1e-9
    )


def test_what_lies_outside_is_said_with_the_range():
    def outside(f: float, v: float, speed: float) -> str:
        return PAIR.outside(sines(np.array([f]), np.array([v]), np.array([0.5]), speed, 0.0))

    assert outside(10.0, 80.0, 0.02) == outside(1e4, 80.0, 0.02) == outside(5e4, 0.0, 0.02) == ""
    assert outside(5e4, 80.0, 0.02) == "frequency_hz 50000..50000 Hz (learned from 10 to 10000)"
    assert outside(100.0, 80.0, 3.0) == ""  # fingers slide as they do


@pytest.mark.parametrize("form", [OVER_FREQUENCY, PAIR], ids=["one input", "pair"])
def test_a_form_reads_back_as_it_was_written(tmp_path, form):
    values = np.random.default_rng(2).normal(0.0, 0.1, len(learned_kind(form).parameters()))
    found = model_with(tmp_path, form, *values)
    assert found.learned_form == form
    assert found.effects == (learned(form, *values),)
    assert found.content_hash != model_with(tmp_path, form, *(values + 0.01)).content_hash
    moved = replace(form, lowest_voltage_v=30.0)
    assert found.content_hash != model_with(tmp_path, moved, *values).content_hash


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('acts_on = "friction"', 'acts_on = "frictoin"', "'frictoin' is unknown"),
        ("with_phase = false", "with_phase = true", "friction has no phase"),
        ("lowest_voltage_v = 40.0", "lowest_voltage_v = 0.0", "not a positive number"),
        (
            "amplitude = 0.1",
            "amplitude = 1e308",
            "amplitude = 1e+308 is not a positive number up to 10",
        ),
        ("frequency_hz = [10.0, 100.0", "frequency_hz = [100.0, 10.0", "no list of rising numbers"),
        ("frequency_hz = [", "frequency = [", "has no input 'frequency'"),
        ("frequency_hz_3 = ", "frequency_hz_4 = ", "unknown key 'frequency_hz_4'"),
    ],
)
def test_a_table_with_a_mistake_is_explained(tmp_path, old, new, words):
    model_with(tmp_path, OVER_FREQUENCY, 0.1, -0.2, 0.3, 0.05)
    path = tmp_path / "learned.toml"
    text = path.read_text()
    assert text.count(old) == 1
    path.write_text(text.replace(old, new))
    with pytest.raises(ModelError, match=r"\[effects.learned\]") as refused:
        read_model(path)
    assert words in refused.value.message
    assert refused.value.hint


def test_without_its_form_it_is_unknown(tmp_path):
    path = tmp_path / "learned.toml"
    path.write_text(f"{SHIPPED}\n[effects.learned]\nfrequency_hz_0 = 0.1\n")
    with pytest.raises(ModelError, match="acts_on is missing"):
        read_model(path)
    path.write_text(f"{SHIPPED}\n[effects]\nlearned = 3\n")
    with pytest.raises(ModelError, match="learned is not a table"):
        read_model(path)


def test_a_term_bends_with_the_drive_where_the_drive_reaches_its_place():
    """One at friction was let off over frequency: which effects are not was said by each of them,
    but not by it.
    """
    assert learned_kind(OVER_FREQUENCY).bends_with() == ()
    assert learned_kind(PAIR).bends_with() == ("frequency_hz",)
