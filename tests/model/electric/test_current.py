import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from model.contact.gap_distribution import gap_distribution
from model.electric.current import current_rms_a, sliding_admittance_per_m, stuck_admittance_per_m
from model.electric.dielectrics import EPS0

FINGERS = ("reference", "table1")
LOG_U = np.arange(np.log(1e-12), np.log(60.0), 0.05)
AREA_M2 = 1e-4
frequencies = st.floats(-1.0, 6.0).map(lambda exponent: 10.0**exponent)


def layer_impedances(model, frequency_hz: float) -> tuple[complex, complex]:
    """Insulator and skin, ohm m2: thickness over (conductivity + j w eps)."""
    v = model.description.values
    jw = 2j * np.pi * frequency_hz
    k_skin = complex(model.description.dielectric.permittivity(np.array([frequency_hz]))[0])
    insulator = v.insulator_thickness_m / (
        jw * EPS0 * v.insulator_permittivity + v.insulator_conductivity_s_per_m
    )
    return insulator, v.skin_thickness_m / (jw * EPS0 * k_skin)


@pytest.fixture(scope="module")
def sliding_rms_a(scales_of, stack_of, circuit_of):
    """Current of the sliding finger, A rms, of frequencies, rms voltages and total pressures that
    broadcast.
    """

    def current(model, frequency_hz, voltage_rms_v, pressure_pa, area_m2: float) -> np.ndarray:
        f, v, p = np.broadcast_arrays(
            *(np.asarray(x, float) for x in (frequency_hz, voltage_rms_v, pressure_pa))
        )
        s, flat = stack_of(model, f.ravel()), np.array(p).ravel()
        circuit = circuit_of(scales_of(model), [(s, v.ravel() ** 2)], flat)
        admittance = sliding_admittance_per_m(model.table, circuit, flat)
        assert admittance.shape == (f.size, 1)
        return current_rms_a(admittance, s.omega[:, None], v.reshape(-1, 1), area_m2).reshape(
            f.shape
        )

    return current


@pytest.mark.parametrize("name", FINGERS)
@given(f=frequencies, p=st.floats(3.0, 5.5).map(lambda e: 10.0**e))
@settings(max_examples=25)
def test_sliding_current_is_the_mean_over_the_gaps(
    models, scales_of, stack_of, sliding_rms_a, name, f, p
):
    """A ladder of admittances for each gap: insulator, then air beside the leak, then skin;
    averaged with P(u).
    """
    model = models[name]
    s, scales = stack_of(model, np.array([f])), scales_of(model)
    insulator, skin = layer_impedances(model, f)
    jw = 2j * np.pi * f
    alpha = s.leak_per_m_pa[0] * p * jw * EPS0
    u_hat = np.exp(LOG_U)
    mass = gap_distribution(model.table.shape, p / scales.pressure_pa).density(u_hat) * u_hat * 0.05
    air = (jw * EPS0 + model.description.values.air_conductivity_s_per_m) / (
        u_hat * scales.length_m
    )
    density = 1.0 / (insulator + skin + 1.0 / (air + alpha))
    expected = AREA_M2 * abs(np.sum(density * mass)) * 30.0
    got = sliding_rms_a(model, [f], 30.0, p, AREA_M2)
    assert got[0] == pytest.approx(
        expected, rel=2e-4
    )  # interpolation 1e-4; the area of P is known to 1e-4 of itself


@pytest.fixture(scope="module")
def stuck_rms_a(scales_of, stack_of, circuit_of):
    """Worst-case current at 30 V rms, A rms."""

    def current(model, frequency_hz: float) -> float:
        s = stack_of(model, np.array([frequency_hz]))
        circuit = circuit_of(scales_of(model), [(s, np.array([900.0]))], np.array([5e3]))
        rms_v = np.full((1, 1), 30.0)
        return float(
            current_rms_a(stuck_admittance_per_m(circuit), s.omega[:, None], rms_v, AREA_M2)[0]
        )

    return current


@given(f=frequencies)
@settings(max_examples=50)
def test_stuck_current_is_limited_by_insulator_and_skin(models, stuck_rms_a, f):
    model = models["reference"]
    expected = AREA_M2 * 30.0 / abs(sum(layer_impedances(model, f)))
    assert stuck_rms_a(model, f) == pytest.approx(expected, rel=1e-12)  # rounding


@pytest.mark.parametrize("name", FINGERS)
@given(f=frequencies, p=st.floats(3.0, 5.5).map(lambda e: 10.0**e))
@settings(max_examples=40)
def test_a_sliding_finger_never_draws_more_than_a_stuck_one(
    models, sliding_rms_a, stuck_rms_a, name, f, p
):
    model = models[name]
    assert 0.0 < sliding_rms_a(model, [f], 30.0, p, AREA_M2)[0] <= stuck_rms_a(model, f)


def test_without_equilibrium_there_is_no_sliding_current(models, sliding_rms_a):
    got = sliding_rms_a(models["table1"], 250.0, 75.0, np.array([np.nan, 5e3]), AREA_M2)
    np.testing.assert_array_equal(np.isnan(got), [True, False])


def test_a_touch_that_is_pulled_in_has_no_current(
    models, scales_of, stack_of, circuit_of, monkeypatch
):
    """Its place once held whatever the memory held before."""
    model = models["reference"]
    pressure_pa = np.array([1e4, np.nan, np.inf])
    stack = stack_of(model, np.full(3, 250.0))
    circuit = circuit_of(scales_of(model), [(stack, np.full(3, 900.0))], pressure_pa)
    monkeypatch.setattr(np, "empty", lambda shape, dtype=float: np.full(shape, 7.0, dtype))
    admittance = sliding_admittance_per_m(model.table, circuit, pressure_pa)
    assert np.isfinite(admittance[0]).all()
    assert np.isnan(admittance[1:].real).all()
    assert np.isnan(admittance[1:].imag).all()
