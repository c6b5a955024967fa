"""A texture in a few numbers: a spectrum of friction at a speed -> waves along a line, with random
phases.

Waves lie on the surface: at twice the speed every frequency doubles, as with a real one. Where a
file has processes for several speeds and loads, every wave keeps its place and phase. Only its
height depends on speed and load.
"""

from __future__ import annotations

import math

import numpy as np

from haptic_driver.errors import BadInputError
from haptic_driver.render.texture import Waves
from haptic_driver.signals import Array
from haptic_driver.textures.bands import BANDS, EDGES_HZ, FINGER_LAG_M
from haptic_driver.textures.description import (
    FINEST_WAVE_MM,
    ProcessDescription,
    SpectrumDescription,
)
from haptic_driver.textures.formulas import random_phases_rad
from haptic_driver.textures.objects import TEXTURE_COF
from haptic_driver.textures.process import coefficients, power, reflections

EDGE = 1e-3  # of the range of a beta distribution, whose density may be endless at its ends
SPEEDS, LOADS = 16, 4  # of a texture that changes with them: 5 to 200 mm/s in steps of 28 %
FAR = 10.0  # times the largest speed and load


def spectrum(described: SpectrumDescription, where: str) -> Waves:
    """One tile for each speed and load; it holds every wave a whole number of times, so that it
    repeats without a seam.

    `where` names the file in the error: BadInputError where friction leaves what a texture may say.
    """
    usual = (1e-3 * described.speed_mm_s, described.normal_force_n)
    if described.process is None:
        speeds, loads, spectra = [described.speed_mm_s], [described.normal_force_n], [described]
    else:
        lowest, highest = described.speeds_mm_s()
        forces_n = [one.normal_force_n for one in described.process]
        speeds = np.unique(np.geomspace(lowest, highest, SPEEDS)).tolist()
        loads = np.unique(np.linspace(min(forces_n), max(forces_n), LOADS)).tolist()
        spectra = _between(
            described, described.process, [(speed, load) for speed in speeds for load in loads]
        )
    count = described.points()
    cof = np.array([_tile(one, count) for one in spectra]).reshape(len(speeds), len(loads), count)
    if not (cof.min() >= TEXTURE_COF[0] and cof.max() <= TEXTURE_COF[1]):  # nor NaN
        said = (
            f"{where}: friction goes from {cof.min():.3g} to {cof.max():.3g}, outside {TEXTURE_COF}"
        )
        raise BadInputError(
            "bad_texture", said, "Lower perceptual_gain, or what the spectrum asks for"
        )
    direction_rad = math.radians(described.direction_deg)
    return Waves(
        cof,
        1e-3 * np.array(speeds),
        np.array(loads),
        1e-3 * described.tile_mm,
        direction_rad,
        usual,
    )


def _between(
    described: SpectrumDescription,
    processes: list[ProcessDescription],
    wanted: list[tuple[float, float]],
) -> list[SpectrumDescription]:
    """A spectrum of one process for each speed and load wanted: linear between those of a file, by
    triangles.

    Far beyond all of them the nearest one holds, so that every place has three around it.
    """
    # slow to import
    from scipy.interpolate import LinearNDInterpolator, NearestNDInterpolator  # noqa: PLC0415

    order = len(processes[0].ar)
    numbers = np.array(
        [[one.cof_rms, *reflections(one.ar), *reflections(one.ma or [])] for one in processes]
    )
    places = np.array([(one.speed_mm_s, one.normal_force_n) for one in processes])
    size = np.maximum(places.max(axis=0), 1e-3)
    corners = np.array([(speed, load) for speed in (-FAR, FAR) for load in (-FAR, FAR)])
    beyond = NearestNDInterpolator(places / size, numbers)(corners)
    linear = LinearNDInterpolator(np.vstack([places / size, corners]), np.vstack([numbers, beyond]))
    return [
        described.model_copy(
            update={
                "process": None,
                "speed_mm_s": speed,
                "cof_rms": max(found[0], 0.0),
                "ar": coefficients(found[1 : 1 + order]).tolist(),
                "ma": coefficients(found[1 + order :]).tolist(),
            }
        )
        for (speed, _), found in zip(wanted, linear(np.array(wanted) / size), strict=True)
    ]


def _tile(described: SpectrumDescription, count: int) -> Array:
    """Friction [count] of a tile, for the speed of the description.

    Waves finer than `FINEST_WAVE_MM` are left out: a finger follows them by half at most.
    """
    tile_mm, speed_mm_s = described.tile_mm, described.speed_mm_s
    waves = np.arange(1, math.floor(EDGES_HZ[-1] * tile_mm / speed_mm_s) + 1)
    phase_rad = random_phases_rad(described.seed, waves.size)
    frequency_hz = waves * speed_mm_s / tile_mm
    amplitude = np.zeros(waves.size)
    heard = frequency_hz >= EDGES_HZ[0]
    amplitude[heard] = described.perceptual_gain * np.sqrt(
        2.0 * _mean_squares(described, frequency_hz[heard])
    )
    if described.invert_finger:
        amplitude *= np.hypot(1.0, math.tau * FINGER_LAG_M * waves / (1e-3 * tile_mm))
    amplitude[waves * FINEST_WAVE_MM > tile_mm] = 0.0
    lines = np.zeros(count // 2 + 1, dtype=complex)
    kept = waves < lines.size
    lines[waves[kept]] = (0.5 * count * amplitude * np.exp(1j * phase_rad))[kept]
    return np.asarray(described.mean_cof + np.fft.irfft(lines, count))


def _mean_squares(described: SpectrumDescription, frequency_hz: Array) -> Array:
    """Of each wave [n], without gains; they sum up to what the description says of all nine
    bands.
    """
    if described.band_cof_rms is not None:
        band = np.clip(np.searchsorted(EDGES_HZ, frequency_hz, side="right") - 1, 0, BANDS - 1)
        return np.asarray(
            (np.square(described.band_cof_rms) / np.bincount(band, minlength=BANDS))[band]
        )
    assert described.cof_rms is not None  # the description has the one or the other
    if described.beta is not None:
        a, b = described.beta
        place = np.log(frequency_hz / EDGES_HZ[0]) / math.log(EDGES_HZ[-1] / EDGES_HZ[0])
        place = np.clip(place, EDGE, 1.0 - EDGE)
        # over the logarithm of frequency
        weight = place ** (a - 1.0) * (1.0 - place) ** (b - 1.0) / frequency_hz
    else:
        assert described.ar is not None
        assert described.rate_hz is not None
        weight = power(frequency_hz, described.rate_hz, described.ar, described.ma or ())
    return np.asarray(described.cof_rms**2 * weight / weight.sum())
