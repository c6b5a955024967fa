import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from model.electric.dielectrics import EPS0
from model.electric.layers import DC_FREQUENCY_HZ, leak_conductance_per_pa

FINGERS = ("reference", "table1")
frequencies = st.floats(-2.0, 8.0).map(lambda exponent: 10.0**exponent)
gaps = st.floats(-10.0, -3.5).map(lambda exponent: 10.0**exponent)
pressures = st.floats(1.0, 6.0).map(lambda exponent: 10.0**exponent)


def network(model, frequency_hz: float, u: float, alpha: float) -> np.ndarray:
    """Fields E1, Eg, E2 for 1 V: the voltages add up and one total current crosses all layers
    (conduction once).
    """
    v = model.description.values
    jw = 2j * np.pi * frequency_hz * EPS0
    k2 = complex(model.description.dielectric.permittivity(np.array([frequency_hz]))[0])
    y1 = jw * v.insulator_permittivity + v.insulator_conductivity_s_per_m
    yg = jw + v.air_conductivity_s_per_m + alpha * u
    rows = [[v.insulator_thickness_m, u, v.skin_thickness_m], [y1, -yg, 0.0], [0.0, yg, -jw * k2]]
    scale = np.abs(np.array(rows)).max(axis=1)
    return np.linalg.solve(np.array(rows) / scale[:, None], np.array([1.0, 0.0, 0.0]) / scale)


@pytest.mark.parametrize("name", FINGERS)
@given(f=frequencies, u=gaps, p=pressures)
@settings(max_examples=60)
def test_field_of_the_gap_is_that_of_the_network(models, stack_of, name, f, u, p):
    model = models[name]
    s = stack_of(model, np.array([f]))
    h, k_gap, leak = s.h_m[0], s.k_gap[0], s.leak_per_m_pa[0] * p
    field = 1.0 / ((1.0 + leak * h) * u + k_gap * h)
    alpha = (leak * 2j * np.pi * f * EPS0).real
    e1, e_gap, e2 = network(model, f, u, alpha)
    assert field == pytest.approx(e_gap, rel=1e-9)  # conditioning of the linear solve
    # conservation: what crosses the insulator is the gap's displacement and conduction, and the
    # leak
    v, jw = model.description.values, 2j * np.pi * f * EPS0
    through_insulator = (jw * v.insulator_permittivity + v.insulator_conductivity_s_per_m) * e1
    across_gap = (jw * k_gap + alpha * u) * field
    assert through_insulator == pytest.approx(across_gap, rel=1e-9)
    assert v.insulator_thickness_m * e1 + u * field + v.skin_thickness_m * e2 == pytest.approx(
        1.0, rel=1e-9
    )


def test_leak_follows_skin_and_scale_not_the_insulator(models, variant):
    """A past reading of (37) put sigma* in series with the insulator: 3.3e-12 S/m2, with nothing to
    leak.
    """
    base = models["reference"].description.values
    insulated = variant(insulator_conductivity_s_per_m=0.0).description.values
    sigma = np.array([2e-4])
    alpha = leak_conductance_per_pa(base, sigma)
    assert alpha * 5e3 == pytest.approx(
        2.0 * 2e-4 * 5e3 / (13.331e6 * 22.096e-6), rel=1e-4
    )  # five digits are known
    assert leak_conductance_per_pa(insulated, sigma) == alpha
    assert leak_conductance_per_pa(
        variant(leak_scale=3.0).description.values, sigma
    ) == pytest.approx(3.0 * alpha)
    assert leak_conductance_per_pa(variant(leak_scale=0.0).description.values, sigma) == 0.0


def test_direct_current_is_the_resistive_divider(models, stack_of):
    v = models["reference"].description.values
    s = stack_of(models["reference"], np.array([0.0]))
    resistance = (
        v.insulator_thickness_m / v.insulator_conductivity_s_per_m + v.skin_thickness_m / 2e-4
    )  # ohm m2
    a = 1.0 + s.leak_per_m_pa[0] * 5e3 * s.h_m[0]
    alpha = 2.0 * 2e-4 * 5e3 / (13.330851e6 * 22.09618e-6)
    # displacement over conduction at the frequency that stands for 0: w eps0 eps1/sigma1 = 2e-6
    assert a == pytest.approx(1.0 + alpha * resistance, rel=1e-5)
    assert s.k_gap[0] * s.h_m[0] == pytest.approx(v.air_conductivity_s_per_m * resistance, rel=1e-5)


def test_direct_current_is_the_limit_of_slow_alternation(models, stack_of):
    f = np.array([0.0, 1e-12, DC_FREQUENCY_HZ, 1e-8, 1e-7])
    s = stack_of(models["reference"], f)
    z = s.k_gap * s.h_m / (1.0 + s.leak_per_m_pa * 5e3 * s.h_m)
    assert np.isfinite(z).all()
    assert z[0] == z[1] == z[2]
    # the slowest layer, air, displaces as much as it conducts at 1.8e-4 Hz: a share f/1.8e-4 Hz is
    # not yet at its limit
    np.testing.assert_allclose(z[3:], z[0], rtol=1e-3)
