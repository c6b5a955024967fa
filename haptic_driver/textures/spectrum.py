"""A texture in a few numbers: a spectrum of friction at a speed -> waves along a line, with random phases.

Waves lie on the surface: at twice the speed every frequency doubles, as with a real one.
"""

from __future__ import annotations

import math

import numpy as np

from haptic_driver.errors import BadInputError
from haptic_driver.render.texture import Profile
from haptic_driver.signals import Array
from haptic_driver.textures.bands import BANDS, EDGES_HZ, FINGER_LAG_M
from haptic_driver.textures.description import FINEST_WAVE_MM, TEXTURE_COF, SpectrumDescription
from haptic_driver.textures.formulas import random_phases_rad

EDGE = 1e-3  # of the range of a beta distribution, whose density may be endless at its ends


def spectrum(described: SpectrumDescription, where: str) -> Profile:
    """One tile; it holds every wave a whole number of times, so that it repeats without a seam.

    Waves finer than `FINEST_WAVE_MM` are left out: a finger follows them by half at most. `where` names the file in the
    error: BadInputError where friction leaves what a texture may say.
    """
    tile_mm, speed_mm_s = described.tile_mm, described.speed_mm_s
    waves = np.arange(1, math.floor(EDGES_HZ[-1] * tile_mm / speed_mm_s) + 1)
    frequency_hz = waves * speed_mm_s / tile_mm
    in_bands = frequency_hz >= EDGES_HZ[0]
    waves, frequency_hz = waves[in_bands], frequency_hz[in_bands]
    amplitude = described.perceptual_gain * np.sqrt(2.0 * _mean_squares(described, frequency_hz))
    if described.invert_finger:
        amplitude *= np.hypot(1.0, math.tau * FINGER_LAG_M * waves / (1e-3 * tile_mm))
    amplitude[waves * FINEST_WAVE_MM > tile_mm] = 0.0
    count = described.points()
    lines = np.zeros(count // 2 + 1, dtype=complex)
    kept = waves < lines.size
    phase_rad = random_phases_rad(described.seed, waves.size)
    lines[waves[kept]] = (0.5 * count * amplitude * np.exp(1j * phase_rad))[kept]
    cof = described.mean_cof + np.fft.irfft(lines, count)
    if not (cof.min() >= TEXTURE_COF[0] and cof.max() <= TEXTURE_COF[1]):  # nor NaN
        said = f"{where}: friction goes from {cof.min():.3g} to {cof.max():.3g}, outside {TEXTURE_COF}"
        raise BadInputError("bad_texture", said, "Lower perceptual_gain, or what the spectrum asks for")
    position_m = 1e-3 * tile_mm * np.arange(count + 1) / count
    return Profile(position_m.tolist(), np.append(cof, cof[0]).tolist(), "tile")


def _mean_squares(described: SpectrumDescription, frequency_hz: Array) -> Array:
    """Of each wave [n], without gains; they sum up to what the description says of all nine bands."""
    if described.band_cof_rms is not None:
        band = np.clip(np.searchsorted(EDGES_HZ, frequency_hz, side="right") - 1, 0, BANDS - 1)
        return np.asarray((np.square(described.band_cof_rms) / np.bincount(band, minlength=BANDS))[band])
    assert described.cof_rms is not None  # the description has the one or the other
    if described.beta is not None:
        a, b = described.beta
        place = np.log(frequency_hz / EDGES_HZ[0]) / math.log(EDGES_HZ[-1] / EDGES_HZ[0])
        place = np.clip(place, EDGE, 1.0 - EDGE)
        weight = place ** (a - 1.0) * (1.0 - place) ** (b - 1.0) / frequency_hz  # over the logarithm of frequency
    else:
        assert described.ar is not None
        assert described.rate_hz is not None
        turn = np.exp(-1j * math.tau * frequency_hz / described.rate_hz)
        weight = np.abs(np.polyval([*described.ar[::-1], 1.0], turn)) ** -2.0
        weight[frequency_hz > described.rate_hz / 2.0] = 0.0
    return np.asarray(described.cof_rms**2 * weight / weight.sum())
