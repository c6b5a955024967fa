"""Gain and coherence by band, against scipy and against what is known of made-up signals."""

import math

import numpy as np
import pytest
from scipy import signal

from haptic_driver.fidelity.spectra import band_spectra
from haptic_driver.textures.bands import CENTRES_HZ, EDGES_HZ
from tests.haptic_driver.fidelity.strokes_of import TICK_S, rough, stroke_of

BELOW_HALF_THE_RATE = 7  # bands that end below 500 Hz
WIDTHS_HZ = np.diff(EDGES_HZ)


def spectra_of(*pairs):
    return band_spectra([stroke_of(asked, felt) for asked, felt in pairs], TICK_S)


def waves(frequencies_hz, amplitudes, seconds=10.0, phases=None, rate_hz=1000.0):
    time_s = np.arange(round(seconds * rate_hz)) / rate_hz
    phases = np.zeros(len(frequencies_hz)) if phases is None else phases
    terms = zip(frequencies_hz, amplitudes, phases, strict=True)
    return 0.6 + sum(a * np.sin(math.tau * f * time_s + p) for f, a, p in terms)


def test_it_is_welch_s_method_as_scipy_computes_it():
    asked = rough(4.25, 1)  # whole segments: 0.5 s, and 15 times half of it
    felt = 0.8 * asked + 0.5 * rough(4.25, 2)
    found = spectra_of((asked, felt))
    how = {"fs": 1000.0, "nperseg": 500, "noverlap": 250, "nfft": 2000, "detrend": "linear"}
    frequency_hz, cross = signal.csd(asked, felt, **how)
    power_asked, power_felt = signal.welch(asked, **how)[1], signal.welch(felt, **how)[1]
    for band in range(BELOW_HALF_THE_RATE):
        low_hz, high_hz = EDGES_HZ[band : band + 2]
        inside = (frequency_hz >= low_hz) & (frequency_hz < high_hz)
        xy, xx, yy = (np.sum(p[inside]) for p in (cross, power_asked, power_felt))
        assert found.gain[band] == pytest.approx(abs(xy) / xx, rel=1e-9)
        assert found.asked_rms[band] == pytest.approx(math.sqrt(xx * frequency_hz[1]), rel=1e-9)
        assert found.felt_rms[band] == pytest.approx(math.sqrt(yy * frequency_hz[1]), rel=1e-9)
        raw = abs(xy) ** 2 / (xx * yy)
        # What is taken out for bias is less than one over the number of estimates.
        estimates = 16 * 0.5 * WIDTHS_HZ[band] / 2.0
        assert raw - 1.0 / estimates < found.coherence[band] < raw


def test_the_bias_of_few_averages_is_taken_out():
    # 2 s of 7 Hz are some 14 estimates: 0.07 in the lowest band if nothing were done, where half of
    # the time less than nothing is left, and shown as nothing.
    found = [spectra_of((rough(2.0, 2 * i), rough(2.0, 2 * i + 1))).coherence for i in range(200)]
    assert np.mean(found, axis=0)[0] < 0.04
    assert np.median(found, axis=0)[0] < 0.01
    # Where they are related by half, bias is a quarter, and nothing is cut off.
    related = []
    for i in range(200):
        asked = rough(2.0, 2 * i)
        related.append(spectra_of((asked, asked + rough(2.0, 2 * i + 1))).coherence)
    assert np.mean(related, axis=0)[:7] == pytest.approx(0.5, abs=0.015)


def test_a_first_order_lag_has_its_gain_at_the_centres_of_bands():
    cutoff_hz = 60.0
    centres_hz = CENTRES_HZ[:7]
    gains = 1.0 / np.hypot(1.0, centres_hz / cutoff_hz)
    phases = -np.arctan(centres_hz / cutoff_hz)
    amplitudes = np.full(7, 0.01)
    asked = waves(centres_hz, amplitudes)
    felt = waves(centres_hz, amplitudes * gains, phases=phases)
    found = spectra_of((asked, felt))
    assert found.gain[:7] == pytest.approx(gains, rel=0.01)
    assert found.coherence[:7] == pytest.approx(np.ones(7), abs=0.01)
    assert found.asked_rms[:7] == pytest.approx(0.01 / math.sqrt(2.0), rel=0.01)
    residual = np.abs(1.0 - gains * np.exp(1j * phases)) * 0.01 / math.sqrt(2.0)
    assert found.residual_rms[:7] == pytest.approx(residual, rel=0.02)


def test_where_nothing_is_asked_nothing_is_judged():
    grating = waves([40.0], [0.1])
    found = spectra_of((grating, 0.9 * grating + 0.001 * rough(10.0, 7)))
    assert np.flatnonzero(np.isfinite(found.gain)).tolist() == [2]  # 31.5 to 50 Hz
    assert found.gain[2] == pytest.approx(0.9, rel=0.01)
    assert np.isnan(spectra_of((np.full(5000, 0.6), rough(5.0, 8))).coherence).all()


def test_bands_above_half_the_rate_are_not_judged():
    asked = rough(10.0, 9)
    assert np.isfinite(spectra_of((asked, asked)).gain).tolist() == [True] * 7 + [False] * 2
    fine = rough(10.0, 9, tick_s=5e-4)
    found = band_spectra([stroke_of(fine, fine)], 5e-4)
    assert np.isfinite(found.gain).all()
    coarse = band_spectra([stroke_of(asked, asked)], 0.01)
    assert np.isfinite(coarse.asked_rms).tolist() == [True] * 3 + [False] * 6


def test_too_little_sliding_is_said_band_by_band():
    asked = rough(0.2, 10)
    assert np.isnan(spectra_of((asked, asked)).asked_rms).all()
    asked = rough(0.5, 10)  # one segment: 7 to 29 Hz times 0.5 s are too few in the lowest bands
    found = spectra_of((asked, asked))
    assert np.isfinite(found.gain).tolist() == [False] * 4 + [True] * 3 + [False] * 2
    assert np.isfinite(found.asked_rms).tolist() == [True] * 7 + [False] * 2


def test_short_strokes_add_up():
    short = [rough(0.3, seed) for seed in range(40)]
    found = spectra_of(*((asked, 0.7 * asked) for asked in short))
    assert found.gain[:7] == pytest.approx(0.7)
    # 40 times 0.3 s of 7 Hz are 44 estimates, 88 degrees of freedom: 7.5 % scatter of an rms.
    expected = 0.03 * np.sqrt(WIDTHS_HZ[:7] / 500.0)
    assert found.asked_rms[:7] == pytest.approx(expected, rel=0.15)


def test_a_gain_that_noise_hides_is_not_told_but_one_of_nothing_is():
    asked = rough(2.0, 11, rms=0.001)
    found = spectra_of((asked, asked + rough(2.0, 12, rms=0.03)))
    assert np.isnan(found.gain).all()
    assert np.isfinite(found.coherence[:7]).all()
    still = spectra_of((asked, np.full(2000, 0.6)))
    assert still.gain[:7] == pytest.approx(0.0, abs=1e-9)
    assert still.coherence[:7] == pytest.approx(0.0, abs=1e-9)
