"""Asked against felt friction in the nine bands of `textures/bands.py`, by Welch's method.

Segments of half a second resolve 2 Hz, a quarter of the lowest band. They overlap by half, which
Carter, Knapp and Nuttall recommend for coherence under a Hann window (IEEE Trans. Audio
Electroacoust. 21, 1973). A straight line is taken out of each: drift would leak into low bands.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy import fft
from numpy.typing import NDArray

from haptic_driver.fidelity.strokes import Stroke, without_line
from haptic_driver.signals import Array
from haptic_driver.textures.bands import BANDS, EDGES_HZ, LEAST_COF

SEGMENT_S = 0.5
# A shorter stroke is one segment if it has half the length: three periods of 12.5 Hz.
LEAST_S = 0.25
# Of independent estimates in a band: with fewer, coherence scatters by more than a tenth.
LEAST_ESTIMATES = 8.0
# Of the time of all windows: averaged over frequency too, one counts by its fourth power over the
# square of its second, 1.94, and overlap by half adds nothing.
WINDOWS_PER_ESTIMATE = 2.0
# Of what is asked in all: below, a Hann window's leakage from other bands hides it.
LEAKAGE = 0.005
MOST_GAIN_ERROR = 0.1  # one standard error; with more it could as well be 0.8 or 1.2


class BandSpectra(NamedTuple):
    """What is found in each band: arrays [BANDS], NaN where it is unknown.

    `asked_rms`, `felt_rms` and `residual_rms` (felt less asked) are friction. `gain` and
    `coherence` are NaN too where nothing is asked and where there was too little sliding, and
    `gain` where noise leaves it too uncertain.
    """

    asked_rms: Array
    felt_rms: Array
    residual_rms: Array
    gain: Array
    coherence: Array


def band_spectra(pieces: Sequence[Stroke], tick_s: float) -> BandSpectra:
    """Compare felt with asked friction, both not averaged, in the bands below half the tick rate.

    `gain` is |sum Sxy| / sum Sxx and `coherence` |sum Sxy|^2 / (sum Sxx sum Syy), summed over the
    band. A delay that turns the phase within a band lowers both. The bias of coherence from few
    averages is taken out.
    """
    longest = round(SEGMENT_S / tick_s)
    size = 4 * longest  # so that bins fill the narrow bands evenly
    frequency_hz = np.asarray(fft.rfftfreq(size, tick_s), dtype=np.float64)
    cross = np.zeros(frequency_hz.size, dtype=complex)
    asked, felt = np.zeros((2, frequency_hz.size))
    weight, windows_s = 0.0, 0.0
    for piece in pieces:
        length = min(piece.asked_cof.size, longest)
        if length * tick_s < LEAST_S:
            continue
        x = _transformed(piece.asked_cof, length, size)
        y = _transformed(piece.felt_cof, length, size)
        ticks = float(piece.asked_cof.size)  # long strokes count for more
        scale = 2.0 * tick_s * ticks / len(x)
        cross += scale * np.sum(x.conj() * y, axis=0)
        asked += scale * np.sum(np.abs(x) ** 2, axis=0)
        felt += scale * np.sum(np.abs(y) ** 2, axis=0)
        weight += ticks
        windows_s += len(x) * length * tick_s
    if weight == 0.0:
        return BandSpectra(*np.full((5, BANDS), np.nan))
    estimates = windows_s * np.diff(EDGES_HZ) / WINDOWS_PER_ESTIMATE
    per_bin = frequency_hz[1] / weight
    return _in_bands(frequency_hz, asked * per_bin, felt * per_bin, cross * per_bin, estimates)


def _transformed(values: Array, length: int, size: int) -> Array:
    """Spectra [segments, frequencies] whose squares are power per hertz, one-sided but for 2."""
    window = np.hanning(length + 1)[:-1]
    step = max(length // 2, 1)
    parts = np.lib.stride_tricks.sliding_window_view(values, length)[::step]
    spectra = fft.rfft(without_line(parts) * window, size)
    return np.asarray(spectra / np.sqrt(np.sum(window**2)))


def _in_bands(
    frequency_hz: Array,
    asked_power: Array,
    felt_power: Array,
    cross_power: NDArray[np.complex128],
    estimates: Array,
) -> BandSpectra:
    """Sum power of each frequency over the bands, and compare."""
    inside = (frequency_hz >= EDGES_HZ[:-1, None]) & (frequency_hz < EDGES_HZ[1:, None])
    asked, felt = (inside * asked_power).sum(axis=1), (inside * felt_power).sum(axis=1)
    cross = (inside * cross_power).sum(axis=1)
    residual = np.maximum(asked + felt - 2.0 * cross.real, 0.0)
    possible = EDGES_HZ[1:] <= frequency_hz[-1]
    rms = [np.where(possible, np.sqrt(power), np.nan) for power in (asked, felt, residual)]
    floor = max(LEAST_COF, LEAKAGE * float(np.sqrt(np.sum(asked_power))))
    judged = (rms[0] > floor) & (estimates >= LEAST_ESTIMATES)
    gain, coherence = np.full((2, BANDS), np.nan)
    powers = (asked[judged], felt[judged], np.abs(cross[judged]))
    gain[judged], coherence[judged] = _compared(*powers, estimates[judged])
    return BandSpectra(rms[0], rms[1], rms[2], gain, coherence)


def _compared(asked: Array, felt: Array, cross: Array, estimates: Array) -> tuple[Array, Array]:
    """Gain, NaN where it is too uncertain, and coherence without its bias."""
    gain = cross / asked
    silent = felt == 0.0
    raw = np.minimum(cross**2 / np.where(silent, np.inf, asked * felt), 1.0)
    # Of unrelated signals n estimates give 1/n; Carter, Knapp and Nuttall.
    coherence = np.maximum(raw - (1.0 - raw) ** 2 / estimates, 0.0)
    # Bendat and Piersol, Random Data: of what is felt, what is not coherent disturbs the gain.
    error = np.sqrt((1.0 - raw) * felt / asked / (2.0 * estimates))
    return np.where(error <= MOST_GAIN_ERROR, gain, np.nan), coherence
