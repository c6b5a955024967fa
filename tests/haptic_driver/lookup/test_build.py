"""Model to surface: axes, provenance, and the numbers themselves against the model asked point by
point.
"""

import json
import math
from dataclasses import replace
from datetime import datetime

import numpy as np
import pytest

from haptic_driver.errors import BadInputError
from haptic_driver.lookup.build import SurfaceAxes, axes_within, build_surface, is_of
from model.conditions import Conditions
from model.effects.learned import LearnedForm, Term, learned_kind
from model.parameters import Parameter

ROUNDING = 1e-12
SMALL = SurfaceAxes(frequency_count=8, voltage_count=4, normal_force_count=4, voltage_high_v=80.0)


def test_axes_are_even_in_log_frequency_voltage_and_log_force():
    axes = SurfaceAxes(10.0, 1e3, 5, 90.0, 4, 0.1, 0.8, 4)
    np.testing.assert_allclose(
        axes.frequency_hz, [10.0, 10**1.5, 100.0, 10**2.5, 1000.0], rtol=ROUNDING
    )
    np.testing.assert_allclose(axes.voltage_v, [0.0, 30.0, 60.0, 90.0], rtol=ROUNDING)
    np.testing.assert_allclose(axes.normal_force_n, [0.1, 0.2, 0.4, 0.8], rtol=ROUNDING)


@pytest.mark.parametrize(
    "wrong",
    [
        {"frequency_low_hz": 0.0},
        {"voltage_high_v": math.nan},
        {"normal_force_low_n": 3.0},
        {"frequency_count": 3},
        {"frequency_count": 200_000},
        {"frequency_count": 2**22, "voltage_count": 2**22, "normal_force_count": 2**22},
    ],
)
def test_axes_that_cannot_carry_a_surface_are_refused(wrong):
    with pytest.raises(BadInputError) as refused:
        SurfaceAxes(**wrong)
    assert refused.value.code == "bad_axes"
    assert refused.value.hint


def test_every_point_is_the_models(small_file, touch):
    f, v, n = np.meshgrid(
        small_file.frequency_hz, small_file.voltage_v, small_file.normal_force_n, indexing="ij"
    )
    answer = touch.predict(Conditions(f.ravel(), v.ravel(), n.ravel()))
    # the surface is solved from 128 pressures per frequency with a cubic between them
    for name in ("cof", "electrostatic_force_n", "current_rms_a"):
        np.testing.assert_allclose(
            getattr(small_file, name).ravel(), getattr(answer, name), rtol=2e-4, atol=1e-12
        )
    stuck = np.broadcast_to(small_file.stuck_current_rms_a[:, :, None], f.shape)
    np.testing.assert_allclose(stuck.ravel(), answer.stuck_current_rms_a, rtol=1e-9)
    np.testing.assert_array_equal(small_file.within_theory.ravel(), answer.within_theory)


def test_within_limits_is_the_public_contact_current(small_file):
    """Worst-case current against 0.5 mA to 2.5 kHz and 20 mA above 100 kHz, by hand."""
    for i, limit_a in ((0, 0.5e-3), (1, 0.5e-3), (2, 0.5e-3), (5, 20e-3)):
        allowed = small_file.stuck_current_rms_a[i, :, None] <= limit_a
        np.testing.assert_array_equal(small_file.within_limits[i], np.broadcast_to(allowed, (8, 4)))
    assert small_file.within_limits.any()
    assert not small_file.within_limits.all()


def test_provenance_says_all_that_is_needed_to_build_it_again(small_file, model_description):
    said = small_file.provenance
    assert set(said) >= {"model", "model_hash", "gap_table_hash", "limits", "program", "scipy"}
    assert said["model"]["dielectric"]["name"] == "gabriel_dry"
    given = {name: entry["value"] for name, entry in said["model"]["parameters"].items()}
    assert given == {name: p.value for name, p in model_description.parameters.items()}
    assert all(entry["source"] and entry["unit"] for entry in said["model"]["parameters"].values())
    assert said["waveform"] == "sine"
    assert said["numpy"] == np.__version__
    assert datetime.fromisoformat(said["built_at"]).tzinfo is not None
    json.dumps(said)  # a file can hold it


def test_a_surface_knows_the_model_that_it_was_solved_from(model_description, small_file):
    assert is_of(small_file, model_description)
    assert not is_of(small_file, replace(model_description, about="another one's words"))
    rougher = replace(model_description.parameters["roughness_rms_m"], value=25e-6)
    parameters = {**model_description.parameters, "roughness_rms_m": rougher}
    assert not is_of(small_file, replace(model_description, parameters=parameters))


def test_an_interval_is_made_where_asked_for_and_says_from_what(
    model_description, limits, small_file
):
    axes = SurfaceAxes(frequency_count=6, voltage_count=8, normal_force_count=4)
    found = build_surface(model_description, limits, axes, with_interval=True)
    assert small_file.cof_interval is None
    low, high = found.cof_interval
    assert (low <= found.cof).all()
    assert (high >= found.cof).all()
    np.testing.assert_array_equal(found.cof, small_file.cof)
    assert found.provenance["uncertainty"]["numbers"]["roughness_rms_m"]["std"] == pytest.approx(
        0.1
    )
    assert (
        build_surface(model_description, limits, axes, with_interval=True).content_hash
        == found.content_hash
    )


@pytest.fixture
def learned(touch):
    """The model with friction learned over 20 Hz to 2 kHz and 0.25 to 1 N, and over speed."""
    terms = (
        Term(("frequency_hz", "normal_force_n"), ((20.0, 200.0, 2e3), (0.25, 1.0))),
        Term(("speed_m_s",), ((0.01, 0.05),)),
    )
    form = LearnedForm("friction", "spline", terms, 40.0)
    numbers = {
        p.name: Parameter(0.1 * i, "1", "") for i, p in enumerate(learned_kind(form).parameters())
    }
    return replace(touch.description, effect_parameters={"learned": numbers}, learned_form=form)


def test_a_surface_is_built_with_what_was_learned_as_far_as_its_range_goes(learned, touch, limits):
    axes = axes_within(learned, SMALL)
    assert (axes.frequency_low_hz, axes.frequency_high_hz) == (20.0, 2e3)
    assert (axes.normal_force_low_n, axes.normal_force_high_n) == (0.25, 1.0)
    assert axes.voltage_high_v == SMALL.voltage_high_v
    built = build_surface(learned, limits, axes)
    plain = build_surface(touch.description, limits, axes)
    at_nodes = np.log(built.cof / plain.cof)[
        0, -1, [0, -1]
    ]  # 20 Hz, the highest voltage, both loads
    held = 0.6 + 0.1 * np.log(2.0) / np.log(5.0)  # of speed at the surface's own, 0.02 m/s
    assert at_nodes == pytest.approx(np.array([0.0, 0.1]) + held, abs=1e-9)
    assert built.correction is not None


@pytest.mark.parametrize(
    ("wider", "words"),
    [
        ({"frequency_high_hz": 3e3}, "frequency_hz 20..3000 Hz (learned from 20 to 2000)"),
        ({"normal_force_high_n": 1.5}, "normal_force_n 0.25..1.5 N (learned from 0.25 to 1)"),
    ],
)
def test_axes_beyond_what_was_learned_are_refused_with_the_range(learned, limits, wider, words):
    with pytest.raises(BadInputError) as refused:
        build_surface(learned, limits, replace(axes_within(learned, SMALL), **wider))
    assert refused.value.code == "outside_range"
    assert words in refused.value.message
    assert "measure there" in refused.value.hint


def test_a_model_whose_worst_case_is_not_finite_has_no_surface(model_description, limits):
    """A learned term that overshoots once gave limits that were no numbers, and 93 kV were asked of
    the gate.
    """
    nodes = (0.0, 81.0, 90.0, 1e5)
    form = LearnedForm("voltage", "spline", (Term(("time_s",), (nodes,), 1.0),), 1.0)
    values = {f"time_s_{i}": Parameter(v, "1", "") for i, v in enumerate((0.0, -20.0, 20.0, 0.0))}
    model = replace(model_description, effect_parameters={"learned": values}, learned_form=form)
    with pytest.raises(BadInputError) as refused:
        build_surface(
            model, limits, SurfaceAxes(frequency_count=6, voltage_count=8, normal_force_count=4)
        )
    assert refused.value.code == "not_finite"
