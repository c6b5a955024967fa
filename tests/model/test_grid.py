"""Surfaces against the model asked point by point, for every effect, and their convergence."""

from dataclasses import replace

import numpy as np
import pytest

from model import gain_curves, grid
from model.chain import prepare
from model.dielectrics import Tabulated
from model.effects import BY_NAME, CATALOGUE
from model.gap_table import LOG_P_AXIS, gap_integrals
from model.parameters import Parameter
from model.touch import Drive
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
    assert apart(model, "cof") < 1e-5  # between nodes of pressure: 3e-6, amplified where the curve is steep
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
def test_only_what_bends_with_voltage_needs_more_than_a_curve(with_effect, kind) -> None:
    """The others must stay with one per frequency, or a live surface is no longer one."""
    model = with_effect(kind)
    drive = Drive(F[:, None], V[None, :], 0.0, 0.5, 0.5, 0.02, 0.0)
    touch = prepare(model.description.values, model.description.dielectric, model.description.effects, drive)
    c = touch.circuit
    parts = (x.reshape(touch.shape) for x in (c.h_m, c.k_gap, c.bypass_per_m, c.leak_per_m_pa, c.gap_shift_m))
    bent = grid.bends(gain_curves.Stack(*parts)).any()
    assert (bent or bool(np.isfinite(c.field_limit_v_per_m).any())) == (kind.name in BENDING)


@pytest.mark.parametrize("deviations", [1.0, 0.0, -1.0, -2.0])
@pytest.mark.parametrize("kind", CATALOGUE, ids=lambda kind: kind.name)
def test_between_solved_voltages_a_surface_follows_every_effect(fresh_tables, models, kind, deviations: float) -> None:
    """Many voltages, of which few are solved, from where the effect is weak to where it is strong."""
    values = {p.name: Parameter(float(p.from_normal(deviations)), p.unit, "") for p in kind.parameters()}
    model = fresh_tables(TouchModel(replace(models["reference"].description, effect_parameters={kind.name: values})))
    follow_single_conditions(model)


@pytest.mark.parametrize("deviations", [0.5, 0.0, -1.0, -2.0])
def test_a_surface_follows_stack_and_field_that_bend_together(fresh_tables, models, deviations: float) -> None:
    values = {
        name: {p.name: Parameter(float(p.from_normal(deviations)), p.unit, "") for p in BY_NAME[name].parameters()}
        for name in BENDING
    }
    model = fresh_tables(TouchModel(replace(models["reference"].description, effect_parameters=values)))
    follow_single_conditions(model)
    follow_single_conditions(model, np.geomspace(1.0, 1e6, 100))  # half of them solved, or less


@pytest.mark.parametrize("kind", CATALOGUE, ids=lambda kind: kind.name)
def test_between_solved_frequencies_a_surface_follows_every_effect(with_effect, kind) -> None:
    follow_single_conditions(with_effect(kind), np.geomspace(1.0, 1e6, 200), np.array([0.0, 20.0, 75.0, 150.0]))


def test_between_solved_frequencies_a_surface_follows_a_users_table_of_skin(fresh_tables, models) -> None:
    """Its permittivity has a kink at every row."""
    f = (1.0, 8.0, 90.0, 1.1e3, 7e3, 1e5, 1e6)
    skin = Tabulated(
        "user", "test", f, (9e4, 6e4, 2e4, 5e3, 1.5e3, 1.1e3, 9e2), (2e-6, 3e-6, 9e-6, 3e-5, 8e-5, 2e-4, 9e-3)
    )
    model = fresh_tables(TouchModel(replace(models["reference"].description, dielectric=skin)))
    follow_single_conditions(model, np.geomspace(1.0, 1e6, 200), np.array([0.0, 20.0, 75.0, 150.0]))


def follow_single_conditions(model: TouchModel, f: np.ndarray | None = None, v: np.ndarray | None = None) -> None:
    f = np.geomspace(1.0, 1e6, 4) if f is None else f
    v = np.linspace(0.0, 150.0, 64) if v is None else v
    surface = model.surface(f, v, N)
    single = model.predict(Conditions(*(x.ravel() for x in np.meshgrid(f, v, N, indexing="ij"))))
    for field in ("electrostatic_force_n", "current_rms_a"):
        got, expected = getattr(surface, field).ravel(), getattr(single, field)
        np.testing.assert_array_equal(np.isnan(got), np.isnan(expected))
        # a twentieth of what references may differ; the force of a few volts is a small difference of pressures
        np.testing.assert_allclose(got, expected, rtol=2e-4, atol=1e-9)
    np.testing.assert_array_equal(surface.within_theory.ravel(), single.within_theory)


@pytest.mark.parametrize("kind", CATALOGUE, ids=lambda kind: kind.name)
def test_speeds_at_once_are_the_surfaces_of_each(with_effect, kind) -> None:
    model, speed = with_effect(kind), np.array([0.0, 0.003, 0.02, 0.4])
    at_once = model.cof_at_speeds(F, V, N, speed)
    for got, s in zip(at_once.swapaxes(0, 1), speed, strict=True):
        np.testing.assert_allclose(got, model.surface(F, V, N, speed_m_s=float(s)).cof, rtol=1e-12)  # rounding


@pytest.mark.parametrize("kind", [kind for kind in CATALOGUE if "speed_m_s" in kind.needs], ids=lambda kind: kind.name)
@pytest.mark.parametrize("deviations", [1.0, 0.0, -1.0, -2.0])
def test_between_solved_speeds_friction_is_that_of_single_conditions(
    fresh_tables, models, kind, deviations: float
) -> None:
    values = {p.name: Parameter(float(p.from_normal(deviations)), p.unit, "") for p in kind.parameters()}
    model = fresh_tables(TouchModel(replace(models["reference"].description, effect_parameters={kind.name: values})))
    speed = np.geomspace(8e-4, 0.5, 15)
    f, s, v, n = (x.ravel() for x in np.meshgrid(F, speed, V, N, indexing="ij"))
    expected = model.predict(Conditions(f, v, n, speed_m_s=s)).cof
    np.testing.assert_allclose(model.cof_at_speeds(F, V, N, speed).ravel(), expected, rtol=1e-3)  # SPEEDS_SMOOTH


def test_a_cap_bends_the_force_without_steps(models, fresh_tables) -> None:
    """The sum over gaps has a kink where the cap ends; its place must not show as the voltage rises."""
    values = {"breakdown_field_v_per_m": Parameter(5e7, "V/m", "")}
    description = replace(models["reference"].description, effect_parameters={"air_breakdown": values})
    model = fresh_tables(TouchModel(description))
    v = np.linspace(100.0, 110.0, 201)
    force = model.predict(Conditions(np.full(v.size, 250.0), v, np.full(v.size, 0.5))).electrostatic_force_n
    third = np.diff(np.log(force), 3)
    assert np.abs(third).max() < 1e-6  # 1e-7; the trapezoid rule alone leaves 2e-5


def test_more_nodes_on_a_curve_converge_on_single_conditions(models, monkeypatch) -> None:
    """Of fourth order: a step half as long leaves a sixteenth of the error at most, until the table's cubics show."""
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
