import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from model.electric.current import sliding_admittance_per_m
from model.electric.dielectrics import EPS0
from tests.model.touches import touches

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


@given(f=frequencies)
@settings(max_examples=50)
def test_stuck_current_is_limited_by_insulator_and_skin(models, f):
    model = models["reference"]
    expected = AREA_M2 * 30.0 / abs(sum(layer_impedances(model, f)))
    found = model.predict(touches(f, 30.0 * 2.0**0.5)).stuck_current_rms_a[0]
    assert found == pytest.approx(expected, rel=1e-12)  # rounding


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
