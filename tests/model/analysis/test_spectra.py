"""Drives beyond the sine, against what squaring a voltage must give and against sampling in
time.
"""

import numpy as np
import pytest

from model.analysis import spectra
from model.analysis.spectra import (
    Tones,
    amplitude_modulated,
    force_spectrum,
    impedance,
    sine,
    square,
    steepness,
)
from model.conditions import Conditions
from model.effects import BY_NAME
from model.electric.dielectrics import EPS0, PowerLaw
from model.support.errors import ModelError
from model.touch_model import TouchModel

AREA, LOAD = 1e-4, 0.5
GAIN = BY_NAME["drive_gain_error"]
TABLE = 2e-4  # of the tabulated integrals against the table's own distributions
LOSSLESS = PowerLaw(eps_inf=1000.0, amplitude=0.0, exponent=0.5, conductivity_s_per_m=0.0)
NO_CONDUCTION = {
    "insulator_conductivity_s_per_m": 0.0,
    "air_conductivity_s_per_m": 0.0,
    "leak_scale": 0.0,
}


@pytest.fixture(scope="module")
def touch(models):
    return models["reference"]


@pytest.fixture(scope="module")
def lossless(variant):
    """Nothing conducts and nothing disperses: the field follows the voltage at every frequency, 0
    included.
    """
    return variant(dielectric=LOSSLESS, **NO_CONDUCTION)


def predicted(model, f, v, offset=0.0):
    one = np.ones(1)
    return model.predict(Conditions(f * one, v * one, LOAD * one, voltage_offset_v=offset * one))


# --- force
# ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("f", [3.0, 250.0, 1e4, 1e6])
@pytest.mark.parametrize("offset", [0.0, 20.0])
def test_the_mean_is_the_models_own_force(touch, f, offset):
    found = force_spectrum(touch, sine(f, 75.0, offset), LOAD)
    expected = predicted(touch, f, 75.0, offset).electrostatic_force_n[0]
    assert found.line(0.0).real == pytest.approx(expected, rel=TABLE)
    assert found.line(0.0).imag == 0.0


def test_a_sine_has_mean_and_second_harmonic_of_equal_size(lossless):
    """sin^2 = 1/2 - cos(2wt)/2."""
    found = force_spectrum(lossless, sine(250.0, 50.0), LOAD)
    np.testing.assert_allclose(found.frequency_hz, [0.0, 500.0])
    assert found.line(500.0) == pytest.approx(found.line(0.0), rel=1e-12)


def test_no_voltage_no_force(touch):
    found = force_spectrum(touch, sine(250.0, 0.0), LOAD)
    np.testing.assert_array_equal(found.frequency_hz, [0.0])
    assert found.force_n[0] == 0.0


def test_every_line_against_sampling_in_time(touch):
    """Three tones and a bias: fields of each gap in time, squared, averaged over gaps, and
    Fourier-transformed.
    """
    tones = Tones(
        np.array([0.0, 40.0, 200.0, 240.0]), np.array([15.0, 20.0 - 5.0j, 30.0j, 10.0 + 0j])
    )
    found = force_spectrum(touch, tones, LOAD)
    _, circuit = spectra._one_touch(touch, tones, LOAD)
    field, mass = spectra._field_per_v(
        touch, circuit, circuit.load_pa + found.line(0.0).real / AREA
    )
    time = np.arange(400) / 400 / 40.0
    phase = np.exp(2j * np.pi * tones.frequency_hz[:, None] * time)
    in_time = ((tones.amplitude_v[:, None] * field).T @ phase).real
    force = 0.5 * EPS0 * AREA * (mass @ in_time**2)
    lines = np.fft.rfft(force) / time.size
    lines[1:] *= 2.0
    for frequency, line in zip(np.arange(lines.size) * 40.0, lines, strict=True):
        assert found.line(frequency) == pytest.approx(line, abs=1e-6 * abs(lines[0])), frequency


def test_the_voltage_in_time_is_the_named_waveform():
    time = (np.arange(100) + 0.5) / 100 / 250.0
    np.testing.assert_allclose(
        sine(250.0, 3.0, 1.0).at(time), 1.0 + 3.0 * np.cos(2 * np.pi * 250.0 * time), atol=1e-12
    )
    flat = np.abs(np.abs(time * 1000.0 % 2.0 - 1.0)) > 0.2  # away from the edges
    found = square(250.0, 3.0, harmonics=400).at(time)
    np.testing.assert_allclose(
        found[flat], 3.0 * np.sign(np.cos(2 * np.pi * 250.0 * time))[flat], atol=0.02
    )
    carrier = 5.0 * (1.0 + 0.3 * np.cos(2 * np.pi * 10.0 * time)) * np.cos(2 * np.pi * 250.0 * time)
    np.testing.assert_allclose(
        amplitude_modulated(250.0, 5.0, 10.0, 0.3).at(time), carrier, atol=1e-12
    )


def test_effects_on_the_drive_act_on_every_tone(touch, with_effects):
    halved = with_effects(GAIN(gain=0.5))
    drive = amplitude_modulated(1000.0, 80.0, 10.0, 0.5)
    found = force_spectrum(halved, drive, LOAD)
    expected = force_spectrum(touch, Tones(drive.frequency_hz, 0.5 * drive.amplitude_v), LOAD)
    np.testing.assert_allclose(found.force_n, expected.force_n, rtol=1e-9)


@pytest.mark.parametrize("name", ["air_breakdown", "trapped_charge"])
def test_effects_that_know_one_tone_only_are_refused(with_effects, name):
    """They act on one amplitude, or add to one mean square."""
    kind = BY_NAME[name]
    touch = with_effects(kind(**{p.name: float(p.median) for p in kind.parameters()}))
    with pytest.raises(ModelError, match=name):
        force_spectrum(touch, sine(250.0, 75.0), LOAD)


def test_drives_that_cannot_be_are_refused(touch):
    with pytest.raises(ModelError, match="frequencies of their own"):
        Tones(np.array([10.0, 10.0]), np.ones(2, complex))
    with pytest.raises(ModelError, match="below the carrier"):
        amplitude_modulated(100.0, 10.0, 100.0, 0.5)
    with pytest.raises(ModelError, match="pulls in"):
        force_spectrum(touch, sine(250.0, 5e4), LOAD)


# --- impedance and current
# ---------------------------------------------------------------------------------------


def test_leak_without_end_leaves_the_stack_alone(variant):
    """alpha -> infinity: the gaps are bridged wherever skin and screen are apart, which is all but
    2e-4 of the area.
    """
    bridged, f = variant(leak_scale=1e6, insulator_conductivity_s_per_m=0.0), np.array([250.0])
    found, stuck = (impedance(bridged, f, LOAD, stuck=stuck)[0] for stuck in (False, True))
    assert found == pytest.approx(stuck, rel=1e-3)


# --- where the force turns steep
# ---------------------------------------------------------------------------------


def test_force_goes_with_the_square_of_few_volts_and_steeper_later(touch):
    v = np.linspace(0.0, 200.0, 101)
    found = steepness(touch, np.array([250.0]), v, np.array([0.1, 0.5]))
    assert np.isnan(found.exponent[:, 0]).all()
    assert found.exponent[0, 1, 1] == pytest.approx(2.0, abs=0.005)
    assert (np.diff(found.exponent[0, 2:70, 1]) > 0.0).all()
    assert found.exponent[0, 70, 0] > found.exponent[0, 70, 1]  # a light touch turns steep first
    force = touch.surface(np.array([250.0]), v[49:52], np.array([0.5])).electrostatic_force_n[
        0, :, 0
    ]
    expected = np.log(force[2] / force[0]) / np.log(v[51] / v[49])
    assert found.exponent[0, 50, 1] == pytest.approx(expected, rel=1e-3)
    assert np.isnan(found.pull_in_v).all()


def test_the_voltage_of_pull_in_is_the_first_without_an_answer(touch, monkeypatch):
    f, v, n = np.array([250.0]), np.linspace(0.0, 100.0, 11), np.array([0.5])
    solved = touch.surface(f, v, n)
    for name in ("electrostatic_force_n", "cof"):
        getattr(solved, name)[0, 7:] = np.nan
    solved.pulled_in[0, 7:] = True
    monkeypatch.setattr(TouchModel, "surface", lambda *_: solved)
    found = steepness(touch, f, v, n)
    assert found.pull_in_v[0, 0] == pytest.approx(70.0)
    assert np.isnan(found.exponent[0, 8:]).all()


def test_effects_on_the_drive_act_on_the_current(with_effects):
    """A weak amplifier's current was that of the voltage asked for; the force was that of the
    voltage delivered.
    """

    def current(gain, voltage_v):
        return predicted(with_effects(GAIN(gain=gain)), 250.0, voltage_v).current_rms_a

    np.testing.assert_allclose(current(0.5, 80.0), current(1.0, 40.0), rtol=1e-9)
