"""The electrode's current and voltage as phasors: against other formulas, limits, and causality."""

import numpy as np
import pytest

from model.conditions import Conditions
from model.contact.gap_distribution import gap_distribution
from model.effects import BY_NAME
from model.electric.dielectrics import EPS0
from tests.model.touches import touches

LOG_U = np.arange(np.log(1e-12), np.log(60.0), 0.05)


def sines(frequency_hz, voltage_v=5.0, **columns) -> Conditions:
    return touches(frequency_hz, voltage_v, **columns)


@pytest.mark.parametrize("frequency_hz", [10.0, 250.0, 1e4, 1e6])
def test_is_the_mean_over_gaps_and_real_contact(models, scales_of, stack_of, frequency_hz):
    """A ladder of admittances for each gap: insulator, air beside the leak, skin; without air where
    they touch.
    """
    model = models["reference"]
    got = model.predict(sines(frequency_hz))
    s, scales, v = (
        stack_of(model, np.array([frequency_hz])),
        scales_of(model),
        model.description.values,
    )
    pressure_pa = (0.5 + got.electrostatic_force_n[0]) / v.contact_area_m2
    jw = 2j * np.pi * frequency_hz
    k_skin = model.description.dielectric.permittivity(np.array([frequency_hz]))[0]
    series = v.insulator_thickness_m / (
        jw * EPS0 * v.insulator_permittivity + v.insulator_conductivity_s_per_m
    )
    series += v.skin_thickness_m / (jw * EPS0 * k_skin)
    u_hat = np.exp(LOG_U)
    contact = gap_distribution(model.table.shape, pressure_pa / scales.pressure_pa)
    mass = contact.density(u_hat) * u_hat * 0.05
    air = (jw * EPS0 + v.air_conductivity_s_per_m) / (u_hat * scales.length_m)
    alpha = s.leak_per_m_pa[0] * pressure_pa * jw * EPS0
    density = np.sum(mass / (series + 1.0 / (air + alpha))) + (1.0 - np.sum(mass)) / series
    expected = 5.0 * v.contact_area_m2 * density
    # The area in contact is what the gaps leave, known to 2e-5 of the whole: so to that share of a
    # stuck finger's.
    known = 2e-4 * abs(expected) + 2e-5 * abs(5.0 * v.contact_area_m2 / series)
    assert abs(got.electrode_current_a[0] - expected) < known


def test_a_series_resistance_is_what_is_left_at_high_frequency(with_effects):
    model = with_effects(BY_NAME["series_resistance"](resistance_ohm=1e6))
    current = model.predict(sines([1e3, 1e5, 1e7])).electrode_current_a
    assert abs(current[2]) == pytest.approx(5e-6, rel=1e-3)  # 0.3 kohm of skin are left
    phase = np.angle(current)
    assert phase[0] > phase[1] > phase[2] > 0.0
    assert phase[2] < 1e-3


def test_stray_current_stands_beside_the_finger_before_any_resistance(variant, with_effects):
    f = np.array([10.0, 1e3, 1e5])
    resistance = BY_NAME["series_resistance"](resistance_ohm=1e5)
    plain = with_effects(resistance).predict(sines(f))
    stray = with_effects(resistance, base=variant(stray_capacitance_f=2e-10)).predict(sines(f))
    beside = stray.electrode_current_a - plain.electrode_current_a
    np.testing.assert_allclose(beside, 2j * np.pi * f * 2e-10 * 5.0, rtol=1e-9)
    np.testing.assert_array_equal(
        stray.current_rms_a, plain.current_rms_a
    )  # what may go through the finger


def test_without_a_finger_only_the_stray_current_is_left(variant):
    f = np.array([10.0, 1e3, 1e5])
    got = variant(stray_capacitance_f=3e-10).predict(sines(f, finger="none"))
    np.testing.assert_allclose(
        got.electrode_current_a, 2j * np.pi * f * 3e-10 * 5.0, rtol=1e-12, atol=1e-30
    )
    np.testing.assert_array_equal(got.electrostatic_force_n, 0.0)
    np.testing.assert_array_equal(got.current_rms_a, 0.0)
    assert np.all(np.isnan(got.cof))


def test_sliding_has_two_to_eleven_times_the_impedance_of_rest(models):
    """Shultz 2018: the gap's impedance rises by 100 to 1000 %; below 100 Hz the leak shorts it
    either way.
    """
    f = np.logspace(2.0, 6.0, 9)
    sliding, resting = (
        models["reference"].predict(sines(f, finger=finger)) for finger in ("sliding", "resting")
    )
    ratio = np.abs(resting.electrode_current_a / sliding.electrode_current_a)
    assert np.all((ratio > 2.0) & (ratio < 11.0))
    assert np.all(np.isnan(resting.cof))
    assert not np.any(np.isnan(resting.electrostatic_force_n))


def test_effects_of_speed_do_not_reach_a_resting_finger(with_effects, models):
    lift = with_effects(BY_NAME["speed_dependent_gap"](lift_m=1e-5, speed_scale_m_s=0.01))
    conditions = sines([250.0, 1e4], finger="resting", speed_m_s=0.1)
    expected = models["reference"].predict(conditions).electrode_current_a
    np.testing.assert_allclose(lift.predict(conditions).electrode_current_a, expected, rtol=1e-12)


def test_square_waves_are_driven_at_their_fundamental(models):
    square = models["reference"].predict(sines(250.0, 1e-3, waveform="square"))
    sine = models["reference"].predict(sines(250.0, 4e-3 / np.pi))
    np.testing.assert_allclose(square.electrode_voltage_v, 4e-3 / np.pi)
    np.testing.assert_allclose(
        square.electrode_current_a, sine.electrode_current_a, rtol=1e-6
    )  # force: 1e-8 N either way


class Debye:
    """Skin of one relaxation at 3 kHz and a steady conduction."""

    name = source = "made up"

    def permittivity(self, frequency_hz):
        return (
            20.0
            + 2000.0 / (1.0 + 1j * frequency_hz / 3e3)
            + 1e-5 / (2j * np.pi * frequency_hz * EPS0)
        )


def test_is_causal(variant):
    """Kramers and Kronig for the complex capacitance I/(j w V), less its steady conduction, at a
    voltage without force.

    C'(f) - C'(inf) = -(2/pi) int x (C''(x) - C''(f) f/x)/(x^2 - f^2) dx, where what is subtracted
    takes out the pole.
    """
    model = variant(
        dielectric=Debye(),
        leak_scale=0.0,
        insulator_conductivity_s_per_m=0.0,
        air_conductivity_s_per_m=0.0,
    )
    log_f = np.linspace(np.log(1e-2), np.log(1e9), 4001)
    f = np.exp(log_f)
    capacitance = model.predict(sines(f, 1e-3)).electrode_current_a / (2j * np.pi * f * 1e-3)
    loss = -capacitance.imag
    for i in range(1200, 3200, 250):
        ratio = (f / f[i]) ** 2
        with np.errstate(divide="ignore", invalid="ignore"):
            under = (ratio * loss - loss[i] * f / f[i]) / (ratio - 1.0)
        under[i] = 0.5 * (under[i - 1] + under[i + 1])
        integral = 2.0 / np.pi * np.trapezoid(under, log_f)
        expected = capacitance.real[i] - capacitance.real[-1]
        assert integral == pytest.approx(expected, abs=3e-4 * capacitance.real[0])
