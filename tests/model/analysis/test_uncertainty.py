"""Intervals of friction against closed forms, linear propagation and convergence."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import norm

from model.analysis import uncertainty
from model.contact.theory_error import theory_log_std
from model.parameters import Parameter
from model.support.errors import ModelError
from model.touch_model import TouchModel

F = np.geomspace(1.0, 1e6, 40)
V = np.linspace(0.0, 120.0, 31)
N = np.geomspace(0.1, 2.0, 5)
QUANTILE_OF_64 = 0.15  # relative error of a 16 % quantile of 64 evenly spread draws


@pytest.fixture(scope="module")
def reference(models):
    return models["reference"].description


@pytest.fixture(scope="module")
def cof(models):
    return models["reference"].surface(F, V, N).cof


@pytest.fixture(scope="module")
def interval(reference, cof):
    return uncertainty.cof_interval(reference, F, V, N, cof)


def only(description, **log_std):
    """The model with these numbers uncertain and no others."""
    parameters = {
        name: replace(p, std=p.value * log_std.get(name, 0.0))
        for name, p in description.parameters.items()
    }
    return replace(description, parameters=parameters)


@pytest.fixture
def exact_theory_and_skin(monkeypatch):
    monkeypatch.setattr(uncertainty, "theory_log_std", lambda p, *_, **__: np.zeros_like(p))
    monkeypatch.setattr(uncertainty, "SKIN_LOG_STD", {})


def test_what_is_uncertain_is_what_the_file_says_and_what_differs_between_fingers(reference):
    found = {u.name: u for u in uncertainty.uncertain_numbers(reference)}
    assert found["roughness_rms_m"].std == pytest.approx(0.1)  # 2 of 20 um
    assert found["leak_scale"].std == pytest.approx(np.log(1.5))  # the file is silent
    assert found["cof_off"].std == pytest.approx(0.006 / 0.512)
    assert not set(found) & set(uncertainty.SHAPE_OF_ROUGHNESS)
    assert set(found) > set(uncertainty.SKIN_LOG_STD)


def test_effects_bring_their_own_uncertainty(reference):
    effect = {"series_resistance": {"resistance_ohm": Parameter(2e4, "ohm", "", 4e3)}}
    numbers = uncertainty.uncertain_numbers(replace(reference, effect_parameters=effect))
    found = {u.name: u for u in numbers}["series_resistance.resistance_ohm"]
    assert found.std == pytest.approx(0.2)
    x = np.array([1.0 if u is found else 0.0 for u in numbers])
    drawn = uncertainty.varied(replace(reference, effect_parameters=effect), numbers, x)
    assert drawn.effects[0].resistance_ohm == pytest.approx(2e4 * np.exp(0.2))
    assert drawn.values == reference.values


@pytest.mark.usefixtures("exact_theory_and_skin")
def test_friction_without_voltage_alone_gives_the_log_normal_quantiles(reference, cof):
    """Friction is proportional to it everywhere."""
    low, high = uncertainty.cof_interval(only(reference, cof_off=0.05), F, V, N, cof)
    expected = 0.05 * norm.ppf(0.84)
    np.testing.assert_allclose(np.log(high / cof), expected, rtol=QUANTILE_OF_64)
    np.testing.assert_allclose(np.log(low / cof), -expected, rtol=QUANTILE_OF_64)


@pytest.mark.usefixtures("exact_theory_and_skin")
def test_a_small_spread_is_carried_linearly(reference, variant, cof):
    """Against a difference quotient of the model: 1 % of insulator thickness."""
    low, high = uncertainty.cof_interval(only(reference, insulator_thickness_m=0.01), F, V, N, cof)
    thick = variant(insulator_thickness_m=1e-6 * 1.01).surface(F, V, N).cof
    driven = (slice(None), slice(10, None))
    width = np.log(high / low)[driven]
    expected = 2.0 * norm.ppf(0.84) * np.abs(np.log(thick / cof))[driven]
    seen = expected > 1e-5
    assert seen.mean() > 0.5
    np.testing.assert_allclose(
        width[seen], expected[seen], rtol=0.3
    )  # quantiles, and curvature where it is steep


def test_the_interval_holds_the_model_and_widens_with_voltage(interval, cof):
    low, high = interval
    assert (low < cof).all()
    assert (high > cof).all()
    width = np.log(high / low)[:, :, 2]
    assert (width[:, 20] > width[:, 5]).all()


def test_the_theory_alone_spreads_the_force_by_what_it_says(reference, monkeypatch):
    """At few volts pressure does not feed back: the rise has the theory's own standard
    deviation.
    """
    monkeypatch.setattr(uncertainty, "SKIN_LOG_STD", {})
    nothing = only(reference)
    nothing = replace(
        nothing, parameters=nothing.parameters | {"leak_scale": Parameter(0.0, "1", "")}
    )
    base = TouchModel(nothing).surface(F, V, N)
    _, high = uncertainty.cof_interval(nothing, F, V, N, base.cof)
    volts, off = 2, 0.512
    insulator = 3.9 + 1e-13 / (2j * np.pi * F * 8.8541878128e-12)
    z = np.abs(1e-6 / insulator + 200e-6 / reference.dielectric.permittivity(F))
    for load in (2, 4):
        std = theory_log_std(N[load] / 1e-4 + base.electrostatic_force_n[:, volts, load] / 1e-4, z)
        rise = (high[:, volts, load] - off) / (base.cof[:, volts, load] - off)
        np.testing.assert_allclose(np.log(rise), std * norm.ppf(0.84), rtol=0.2)


def test_a_contact_that_may_have_pulled_in_has_no_upper_end():
    ratio = np.full((2, 2, 2), 1.5)
    ratio[1, 1, 1] = np.inf
    halfway = np.array([[1.0, 0.0], [0.5, 0.5]])
    found = uncertainty._interpolated(ratio, halfway, halfway)
    assert found[0, 0, 0] == pytest.approx(1.5)
    assert found[1, 1, 1] == np.inf
    assert np.isinf(found).sum() == 1


@pytest.mark.parametrize(
    "effects", [{}, {"series_resistance": {"resistance_ohm": Parameter(2e4, "ohm", "", 4e3)}}]
)
@pytest.mark.parametrize(
    ("frequency_hz", "voltage_v", "normal_force_n"), [(200.0, 60.0, 0.5), (2e4, 0.0, 1.0)]
)
def test_under_one_condition_the_interval_is_that_of_the_surface(
    reference, monkeypatch, effects, frequency_hz, voltage_v, normal_force_n
):
    """Solved apart, by the same draws; the surface interpolates the voltage that a wrong theory
    stands for.
    """
    reference = replace(reference, effect_parameters=effects)
    monkeypatch.setattr(uncertainty, "DRAWS_AT_ONE", uncertainty.DRAWS)
    f, v, n = np.array([frequency_hz]), np.linspace(0.0, 120.0, 31), np.array([normal_force_n])
    surface = uncertainty.cof_interval(
        reference, f, v, n, TouchModel(reference).surface(f, v, n).cof
    )
    there = np.searchsorted(v, voltage_v)
    found = uncertainty.cof_interval_at(reference, frequency_hz, voltage_v, normal_force_n)
    np.testing.assert_allclose(found, [end[0, there, 0] for end in surface], rtol=2e-3)


def test_the_printed_equations_carry_none(reference, cof):
    with pytest.raises(ModelError, match="printed"):
        uncertainty.cof_interval(replace(reference, variant="published"), F, V, N, cof)
    with pytest.raises(ModelError, match="printed"):
        uncertainty.cof_interval_at(replace(reference, variant="published"), 200.0, 60.0, 0.5)
