"""Demodulation against signals written down exactly, and against noise of known size."""

import numpy as np
import pytest

from hw.analog.demodulation import demodulate, highest_carrier_hz, whole_periods

RATE_HZ = 20e3


def record(frequency_hz, n, parts, mean=0.0, rate_hz=RATE_HZ):
    """A sum of cosines: {harmonic: (amplitude, phase)}."""
    t = np.arange(n) / rate_hz
    waves = (a * np.cos(2 * np.pi * k * frequency_hz * t + phi) for k, (a, phi) in parts.items())
    return mean + sum(waves)


@pytest.mark.parametrize("frequency_hz", [1.0, 10.0, 249.9, 250.0, 1234.5, 3000.0])
def test_amplitudes_phases_and_mean_of_an_exact_signal(frequency_hz):
    parts = {1: (1.7, 0.6), 2: (0.05, -2.0), 3: (0.02, 1.1)}
    n = whole_periods(frequency_hz, RATE_HZ, 0.1)
    two = np.column_stack(
        [record(frequency_hz, n, parts, 0.3), record(frequency_hz, n, {1: (0.2, -3.0)})]
    )
    found = demodulate(two, RATE_HZ, frequency_hz)
    np.testing.assert_allclose(
        found.fundamental, [1.7 * np.exp(0.6j), 0.2 * np.exp(-3.0j)], atol=1e-9
    )
    np.testing.assert_allclose(found.second, [0.05 * np.exp(-2.0j), 0.0], atol=1e-9)
    np.testing.assert_allclose(found.third, [0.02 * np.exp(1.1j), 0.0], atol=1e-9)
    np.testing.assert_allclose(found.mean, [0.3, 0.0], atol=1e-9)
    assert np.all(found.std < 1e-9)


def test_noise_shrinks_with_the_root_of_the_record_and_is_told():
    rng = np.random.default_rng(5)
    spread = {}
    for n in (400, 6400):
        signal = record(250.0, n, {1: (1.0, 0.4)})[:, None] + 0.1 * rng.standard_normal((n, 400))
        found = demodulate(signal, RATE_HZ, 250.0)
        error = found.fundamental - np.exp(0.4j)
        spread[n] = np.sqrt(np.mean(np.abs(error) ** 2) / 2)
        # Hann's equivalent noise bandwidth of 1.5 bins: variance 2 s^2 / n of each part, times 1.5
        # (Harris 1978)
        assert spread[n] == pytest.approx(0.1 * np.sqrt(3.0 / n), rel=0.08)
        assert np.mean(found.std) == pytest.approx(spread[n], rel=0.08)
    assert spread[400] / spread[6400] == pytest.approx(4.0, rel=0.15)


def test_another_frequency_in_the_record_is_kept_out():
    """Mains hum beside the carrier: the window's side lobes fall by 18 dB per octave."""
    n = whole_periods(1000.0, RATE_HZ, 0.2)
    hum = record(50.0, n, {1: (1.0, 0.2)})
    found = demodulate((record(1000.0, n, {1: (0.01, 0.5)}) + hum)[:, None], RATE_HZ, 1000.0)
    assert abs(found.fundamental[0] - 0.01 * np.exp(0.5j)) < 1e-5


def test_harmonics_beyond_half_the_sampling_rate_are_not_told():
    n = whole_periods(6000.0, RATE_HZ, 0.05)
    found = demodulate(record(6000.0, n, {1: (1.0, 1.0)})[:, None], RATE_HZ, 6000.0)
    assert found.fundamental[0] == pytest.approx(np.exp(1j))
    assert np.isnan(found.second[0])
    assert np.isnan(found.third[0])


@pytest.mark.parametrize("frequency_hz", [8001.0, 10e3, 20e3, 40e3, 100e3])
def test_a_carrier_that_aliases_is_refused(frequency_hz):
    assert highest_carrier_hz(RATE_HZ) == 8000.0
    with pytest.raises(ValueError, match="at most 8000 Hz"):
        demodulate(np.zeros((400, 1)), RATE_HZ, frequency_hz)


def test_less_than_a_period_is_refused():
    assert whole_periods(3.0, RATE_HZ, 0.1) == 6667
    with pytest.raises(ValueError, match="no whole period"):
        demodulate(np.zeros((6666, 1)), RATE_HZ, 3.0)
