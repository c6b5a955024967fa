import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from model.contact import gap_distribution
from model.current import sliding_current_rms_a, stuck_current_rms_a
from model.dielectrics import EPS0

FINGERS = ("reference", "table1")
LOG_U = np.arange(np.log(1e-12), np.log(60.0), 0.05)
AREA_M2 = 1e-4
frequencies = st.floats(-1.0, 6.0).map(lambda exponent: 10.0**exponent)


def layer_impedances(model, frequency_hz: float) -> tuple[complex, complex]:
    """Insulator and skin, ohm m2: thickness over (conductivity + j w eps)."""
    v = model.description.values
    jw = 2j * np.pi * frequency_hz
    k_skin = complex(model.description.dielectric.permittivity(np.array([frequency_hz]))[0])
    insulator = v.insulator_thickness_m / (jw * EPS0 * v.insulator_permittivity + v.insulator_conductivity_s_per_m)
    return insulator, v.skin_thickness_m / (jw * EPS0 * k_skin)


@pytest.mark.parametrize("name", FINGERS)
@given(f=frequencies, p=st.floats(3.0, 5.5).map(lambda e: 10.0**e))
@settings(max_examples=25, deadline=None)
def test_sliding_current_is_the_mean_over_the_gaps(models, name: str, f: float, p: float) -> None:
    """A ladder of admittances for each gap: insulator, then air beside the leak, then skin; averaged with P(u)."""
    model = models[name]
    s, scales = model.stack(np.array([f])), model.scales
    insulator, skin = layer_impedances(model, f)
    jw = 2j * np.pi * f
    alpha = s.leak_per_m_pa[0] * p * jw * EPS0
    u_hat = np.exp(LOG_U)
    mass = gap_distribution(model.table.shape, p / scales.pressure_pa).density(u_hat) * u_hat * 0.05
    air = (jw * EPS0 + model.description.values.air_conductivity_s_per_m) / (u_hat * scales.length_m)
    density = 1.0 / (insulator + skin + 1.0 / (air + alpha))
    expected = AREA_M2 * abs(np.sum(density * mass)) * 30.0
    got = sliding_current_rms_a(model.table, scales, s, np.array([30.0]), np.array([p]), AREA_M2)
    assert got[0] == pytest.approx(expected, rel=2e-4)  # interpolation 1e-4; the area of P is known to 1e-4 of itself


@given(f=frequencies)
@settings(max_examples=50, deadline=None)
def test_stuck_current_is_limited_by_insulator_and_skin(models, f: float) -> None:
    model = models["reference"]
    expected = AREA_M2 * 30.0 / abs(sum(layer_impedances(model, f)))
    got = stuck_current_rms_a(model.stack(np.array([f])), np.array([30.0]), AREA_M2)
    assert got[0] == pytest.approx(expected, rel=1e-12)  # rounding


@pytest.mark.parametrize("name", FINGERS)
@given(f=frequencies, p=st.floats(3.0, 5.5).map(lambda e: 10.0**e))
@settings(max_examples=40, deadline=None)
def test_a_sliding_finger_never_draws_more_than_a_stuck_one(models, name: str, f: float, p: float) -> None:
    model = models[name]
    s, v = model.stack(np.array([f])), np.array([30.0])
    sliding = sliding_current_rms_a(model.table, model.scales, s, v, np.array([p]), AREA_M2)
    assert 0.0 < sliding[0] <= stuck_current_rms_a(s, v, AREA_M2)[0]


def test_currents_are_proportional_to_voltage_and_area(models) -> None:
    model = models["table1"]
    s, p = model.stack(np.array([250.0, 1e4])), np.array([5e3, 5e3])
    for current in (
        lambda v, a: sliding_current_rms_a(model.table, model.scales, s, np.full(2, v), p, a),
        lambda v, a: stuck_current_rms_a(s, np.full(2, v), a),
    ):
        np.testing.assert_allclose(current(20.0, 3e-4), 6.0 * current(10.0, 1e-4), rtol=1e-12)  # rounding


def test_without_equilibrium_there_is_no_sliding_current(models) -> None:
    model = models["table1"]
    s = model.stack(np.array([250.0]))
    got = sliding_current_rms_a(model.table, model.scales, s, np.array([75.0]), np.array([np.nan, 5e3]), AREA_M2)
    np.testing.assert_array_equal(np.isnan(got), [True, False])


def test_grids_broadcast(models) -> None:
    model = models["table1"]
    s = model.stack(np.array([50.0, 250.0, 1e4])).reshaped((-1, 1, 1))
    pressure = np.linspace(2e3, 2e4, 8).reshape(1, 2, 4)
    volts = np.array([10.0, 20.0])[:, None]
    grid = sliding_current_rms_a(model.table, model.scales, s, volts, pressure, AREA_M2)
    assert grid.shape == (3, 2, 4)
    one = sliding_current_rms_a(
        model.table, model.scales, model.stack(np.array([250.0])), np.array([20.0]), pressure[0, 1, 2:3], AREA_M2
    )
    assert grid[1, 1, 2] == pytest.approx(one[0], rel=1e-14)  # rounding
