"""A sampled record of an alternating signal -> its amplitude and phase at the carrier, its
harmonics and its mean.

Pure functions over arrays; the carrier's frequency is known, since it was commanded.
"""

from __future__ import annotations

from math import ceil, floor, pi, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hw.analog.output import Array

# of the sampling rate: the highest carrier, with room for the monitor's own edges below a half
NYQUIST_SHARE = 0.4
HARMONICS = 3

ComplexArray = NDArray[np.complex128]


class Spectrum(NamedTuple):
    """What c signals hold, arrays [c].

    `fundamental`, `second` and `third` are peak phasors: A exp(j phi) stands for A cos(w t + phi),
    t = 0 at the first sample. A harmonic that the sampling rate cannot tell from others is NaN.
    `std` is the standard deviation of the real part of the fundamental, and of its imaginary part,
    that the scatter around the fit implies.
    """

    fundamental: ComplexArray
    second: ComplexArray
    third: ComplexArray
    mean: Array
    std: Array


def highest_carrier_hz(sample_rate_hz: float) -> float:
    """The highest carrier that a sampling rate tells from all lower ones."""
    return NYQUIST_SHARE * sample_rate_hz


def whole_periods(frequency_hz: float, sample_rate_hz: float, duration_s: float) -> int:
    """Samples of a record of about `duration_s`: as many whole periods as fit into it, at least
    one.
    """
    periods = max(1, floor(duration_s * frequency_hz * (1.0 + 1e-9)))
    return ceil(periods * sample_rate_hz / frequency_hz - 1e-9)


def demodulate(samples: Array, sample_rate_hz: float, frequency_hz: float) -> Spectrum:
    """Mean, fundamental and harmonics of signals `samples` [n, c] by least squares with a Hann
    window's weights.

    Over whole periods the fit equals the product with cosine and sine under the window (quadrature
    demodulation). It stays exact where a period is no whole number of samples. Noise of standard
    deviation s per sample leaves s sqrt(3 / n) in each part. A third harmonic aliases onto a
    carrier at a quarter of the sampling rate, a second at a third of it: take another. ValueError
    for a carrier that aliases itself, or a record shorter than a period.
    """
    n = samples.shape[0]
    if not 0.0 < frequency_hz <= highest_carrier_hz(sample_rate_hz) * (1.0 + 1e-9):
        highest_hz = highest_carrier_hz(sample_rate_hz)
        raise ValueError(
            f"{frequency_hz:g} Hz aliases at {sample_rate_hz:g} samples/s: at most"
            f" {highest_hz:g} Hz"
        )
    if n < whole_periods(frequency_hz, sample_rate_hz, 0.0) or n <= 1 + 2 * HARMONICS:
        raise ValueError(
            f"{n} samples at {sample_rate_hz:g} per s hold no whole period of {frequency_hz:g} Hz"
        )
    phase = 2.0 * pi * frequency_hz / sample_rate_hz * np.arange(n)
    told = [
        k for k in range(1, HARMONICS + 1) if k * frequency_hz < 0.5 * sample_rate_hz * (1.0 - 1e-6)
    ]
    basis = np.column_stack(
        [np.ones(n), *(part(k * phase) for k in told for part in (np.cos, np.sin))]
    )
    weight = np.sin(pi * (np.arange(n) + 0.5) / n) ** 2
    weighted = basis * weight[:, None]
    inverse = np.linalg.inv(basis.T @ weighted)
    fitted = inverse @ (weighted.T @ samples)
    scatter = np.sum((samples - basis @ fitted) ** 2, axis=0) / (n - basis.shape[1])
    spread = inverse @ (weighted.T @ weighted) @ inverse
    std = np.sqrt(scatter) * sqrt(0.5 * (spread[1, 1] + spread[2, 2]))
    missing = np.full(samples.shape[1], complex(np.nan, np.nan))
    harmonics = {k: fitted[2 * i + 1] - 1j * fitted[2 * i + 2] for i, k in enumerate(told)}
    first, second, third = (harmonics.get(k, missing) for k in (1, 2, 3))
    return Spectrum(first, second, third, fitted[0], std)
