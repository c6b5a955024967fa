"""Surfaces against the model asked point by point, for every effect, and their convergence."""

from dataclasses import replace

import numpy as np
import pytest

from model import grid
from model.effects import CATALOGUE
from model.gap_table import LOG_P_AXIS, gap_integrals
from model.parameters import Parameter
from model.touch_model import Conditions, TouchModel

F = np.geomspace(1.0, 1e6, 7)
V = np.array([0.0, 10.0, 45.0, 90.0, 150.0])
N = np.array([0.1, 0.4, 2.0])
POINTS = [x.ravel() for x in np.meshgrid(F, V, N, indexing="ij")]
BENDING = {"skin_nonlinearity", "air_breakdown"}  # of the stack or the field, with voltage


@pytest.fixture(scope="module")
def with_effect(fresh_tables, models):
    """The reference model with one effect, a standard deviation above its prior's median."""

    def make(kind) -> TouchModel:
        values = {p.name: Parameter(float(p.from_normal(1.0)), p.unit, "") for p in kind.parameters()}
        return fresh_tables(TouchModel(replace(models["reference"].description, effect_parameters={kind.name: values})))

    return make


def apart(model: TouchModel, name: str) -> float:
    """Largest relative difference of a surface from single conditions."""
    surface, single = model.surface(F, V, N), model.predict(Conditions(*POINTS))
    got, expected = getattr(surface, name).ravel(), getattr(single, name)
    np.testing.assert_array_equal(np.isnan(got), np.isnan(expected))
    return float(np.nanmax(np.abs(got - expected) / np.maximum(np.abs(expected), 1e-9)))


@pytest.mark.parametrize("kind", CATALOGUE, ids=lambda kind: kind.name)
def test_a_surface_has_every_effect_as_single_conditions_have_it(with_effect, kind) -> None:
    model = with_effect(kind)
    assert apart(model, "cof") < 1e-5  # cubic between nodes of pressure: 3e-6, amplified where the curve is steep
    assert apart(model, "current_rms_a") < 1e-5
    surface, single = model.surface(F, V, N), model.predict(Conditions(*POINTS))
    stuck = np.broadcast_to(surface.stuck_current_rms_a[:, :, None], surface.cof.shape).ravel()
    np.testing.assert_allclose(stuck, single.stuck_current_rms_a, rtol=1e-12)  # rounding
    np.testing.assert_array_equal(surface.within_theory.ravel(), single.within_theory)


@pytest.mark.parametrize("kind", CATALOGUE, ids=lambda kind: kind.name)
def test_speed_and_time_reach_a_surface(with_effect, kind) -> None:
    model = with_effect(kind)
    surface = model.surface(F, V, N, speed_m_s=0.1, time_s=30.0)
    n = POINTS[0].size
    single = model.predict(Conditions(*POINTS, speed_m_s=np.full(n, 0.1), time_s=np.full(n, 30.0)))
    np.testing.assert_allclose(surface.cof.ravel(), single.cof, rtol=1e-5)


@pytest.mark.parametrize("kind", CATALOGUE, ids=lambda kind: kind.name)
def test_only_what_bends_with_voltage_needs_more_than_one_curve(with_effect, kind, monkeypatch) -> None:
    """The others must stay on the fast path, or a live surface is no longer one."""
    asked, solve = [], grid.solve_grid
    monkeypatch.setattr(grid, "solve_grid", lambda *args: asked.append(args) or solve(*args))
    with_effect(kind).surface(F, V, N)
    assert bool(asked) == (kind.name not in BENDING)


def test_more_nodes_on_a_curve_converge_on_single_conditions(models, monkeypatch) -> None:
    """Cubic: a step half as long leaves a sixteenth of the error, until the table's own cubics show."""
    errors = []
    for nodes in (1, 2):
        monkeypatch.setattr(grid, "NODES_PER_ROW", nodes)
        errors.append(apart(models["reference"], "cof"))
    assert errors[1] < errors[0] / 4.0  # the table is smooth only between its own nodes
    assert errors[1] < 5e-6


@pytest.mark.parametrize("name", ["reference", "table1"])
def test_the_tables_step_of_pressure_is_of_fourth_order(models, name: str) -> None:
    """Cubics through direct quadratures 4, 2 and 1 steps of the table apart, in the middle between two of them."""
    shape = models[name].table.shape
    table_step = (LOG_P_AXIS[1] - LOG_P_AXIS[0]) / (LOG_P_AXIS[2] - 1)
    weights = np.array([-1.0, 9.0, 9.0, -1.0]) / 16.0

    def log_k(log_p: float) -> float:
        return float(np.log(gap_integrals(shape, float(np.exp(log_p)), np.array([0.03 + 0.01j]))[0][0]))

    for middle in np.log([5e-3, 2e-2, 0.1]):
        errors = []
        for steps in (4.0, 2.0, 1.0):
            nodes = middle + steps * table_step * np.array([-1.5, -0.5, 0.5, 1.5])
            errors.append(abs(weights @ [log_k(x) for x in nodes] - log_k(middle)))
        assert errors[1] < errors[0] / 8.0  # 16 in the limit
        assert errors[2] < errors[1] / 8.0
        assert errors[2] < 1e-4  # what a table may differ from direct quadrature
