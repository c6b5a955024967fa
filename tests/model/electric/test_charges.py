from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from haptic_driver.lab.figures.closed_forms import closed_form
from model.electric.charges import Layers, coefficients, constant_layers
from model.electric.dielectrics import EPS0
from model.support.errors import ModelError

FINGERS = ("reference", "table1")
GAP_M = np.array([1e-8, 1e-6, 44e-6])
KEY_HZ = 250.0


def gap_field(layers: Layers, gap_m: np.ndarray, rho1: np.ndarray, rho2: np.ndarray) -> np.ndarray:
    """(10): the field of the gap under 1 V and interface charges; everything broadcasts."""
    l1, lg, l2 = layers.elastances(gap_m)
    return (1.0 + l1 * rho1 - l2 * rho2) / (l1 + lg + l2) / layers.air_permittivity_f_per_m


@pytest.fixture(scope="module")
def layers_of(models):
    """The layers of a shipped model, the skin at 250 Hz unless told otherwise."""

    def of(name: str = "reference", at_hz: float = KEY_HZ, alpha: float = 0.0) -> Layers:
        d = models[name].description
        return replace(
            constant_layers(d.values, d.dielectric, at_hz), contact_conductance_s_per_m2=alpha
        )

    return of


def rates(
    layers: Layers, gap_m: float, voltage_v: float, rho: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """d rho/dt and the fields from (2)-(8), the laws as one linear system: no formula of
    (9)-(17).
    """
    e1, eg, e2 = (
        layers.insulator_permittivity_f_per_m,
        layers.air_permittivity_f_per_m,
        layers.skin_permittivity_f_per_m,
    )
    law = np.array(
        [
            [-e1, eg, 0.0],
            [0.0, -eg, e2],
            [layers.insulator_thickness_m, gap_m, layers.skin_thickness_m],
        ]
    )  # (4), (5), (8)
    size = np.abs(law).max(axis=1)
    field = np.linalg.solve(law / size[:, None], np.array([rho[0], rho[1], voltage_v]) / size)
    conductivity = np.array(
        [
            layers.insulator_conductivity_s_per_m,
            layers.air_conductivity_s_per_m + layers.contact_conductance_s_per_m2 * gap_m,
            layers.skin_conductivity_s_per_m,
        ]
    )
    current = conductivity * field
    return np.array([current[0] - current[1], current[1] - current[2]]), field


def by_ode(layers: Layers, gap_m: float, time_s: np.ndarray, voltage) -> np.ndarray:
    """Charges [2, t] by scipy's stiff solver, in units of the charge that 1 V puts on the gap."""
    unit = EPS0 / (gap_m + 1e-6)
    found = solve_ivp(
        lambda t, y: rates(layers, gap_m, float(voltage(t)), y * unit)[0] / unit,
        (time_s[0], time_s[-1]),
        np.zeros(2),
        method="Radau",
        t_eval=time_s,
        rtol=1e-9,  # so that its accumulated error stays below the 1e-8 asked of ours
        atol=1e-13,
    )
    assert found.success
    return found.y * unit


class TestAgainstAnOdeSolver:
    """Asked: 1e-8."""

    @pytest.mark.parametrize("gap_m", [1e-6, 44e-6])
    @pytest.mark.parametrize(
        "until_s", [1e-3, 5e3]
    )  # the skin's charging, and that of the slowest layer
    def test_direct_current(self, layers_of, gap_m, until_s):
        layers, time = layers_of(), np.linspace(0.0, until_s, 41)
        expected = by_ode(layers, gap_m, time, lambda t: 1.0)
        closed = closed_form(coefficients(layers, gap_m), 0.0).charges(time)
        for rho, wanted in zip(closed, expected, strict=True):
            np.testing.assert_allclose(rho, wanted, rtol=1e-8, atol=1e-8 * np.abs(wanted).max())

    @pytest.mark.parametrize("frequency_hz", [1.0, 250.0, 1e4])
    def test_alternating_current(self, layers_of, frequency_hz):
        layers, gap_m = layers_of(at_hz=frequency_hz), 44e-6
        time = np.linspace(0.0, 3.0 / frequency_hz, 61)
        expected = by_ode(layers, gap_m, time, lambda t: np.cos(2.0 * np.pi * frequency_hz * t))
        closed = closed_form(coefficients(layers, gap_m), frequency_hz).charges(time)
        for rho, wanted in zip(closed, expected, strict=True):
            np.testing.assert_allclose(rho, wanted, rtol=1e-8, atol=1e-8 * np.abs(wanted).max())


class TestClosedFormAsPrinted:
    """Where the gap conducts better than its neighbours, the two charges couple and the missing
    terms show.
    """

    COUPLED = Layers(1e-6, EPS0, 1e-10, EPS0, 1e-9, 2e-6, EPS0, 3e-10)
    GAP_M = 1e-6

    def test_only_the_mended_ones_follow_the_solver(self):
        k = coefficients(self.COUPLED, self.GAP_M)
        time = np.linspace(0.0, 0.1, 50)
        exact = by_ode(self.COUPLED, self.GAP_M, time, lambda t: 1.0)
        mended, printed = (closed_form(k, 0.0, printed=p).charges(time) for p in (False, True))
        for i, rho in enumerate(exact):
            scale = np.abs(rho).max()
            assert np.abs(mended[i] - rho).max() < 1e-8 * scale
            assert np.abs(printed[i] - rho).max() > 0.05 * scale


@pytest.mark.parametrize("name", FINGERS)
@pytest.mark.parametrize("frequency_hz", [1.0, 250.0, 1e5])
@pytest.mark.parametrize("with_leak", [False, True])
def test_steady_alternation_is_the_frequency_domain(
    models, layers_of, stack_of, name, frequency_hz, with_leak
):
    """Section 2 of the physics at the frequency where the constants are taken, with alpha = 0 and
    with the leak.
    """
    model, jw = models[name], 2j * np.pi * frequency_hz
    stack = stack_of(model, np.array([frequency_hz]))
    beta = stack.leak_per_m_pa[0] * 5e3 if with_leak else 0.0
    layers = layers_of(name, frequency_hz, alpha=float((beta * jw * EPS0).real))
    expected = 1.0 / ((1.0 + beta * stack.h_m[0]) * GAP_M + stack.k_gap[0] * stack.h_m[0])
    rho1, rho2 = coefficients(layers, GAP_M).response(jw)
    np.testing.assert_allclose(gap_field(layers, GAP_M, rho1, rho2), expected, rtol=1e-9)
    closed = closed_form(coefficients(layers, GAP_M), frequency_hz)
    # the phasor of rho1 = alpha_1 cos + alpha_2 sin
    np.testing.assert_allclose(closed.alpha[0] - 1j * closed.alpha[1], rho1, rtol=1e-9)
    np.testing.assert_allclose(closed.beta[0] - 1j * closed.beta[1], rho2, rtol=1e-9)


class TestInput:
    @pytest.mark.parametrize("at_hz", [0.0, -1.0, np.nan, np.inf])
    def test_constants_need_a_frequency(self, layers_of, at_hz):
        with pytest.raises(ModelError, match="is no frequency"):
            layers_of(at_hz=at_hz)
