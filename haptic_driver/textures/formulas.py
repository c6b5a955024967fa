"""Textures by formula, and maps made as coarse as a finger can be driven: numbers -> numbers, no
files.
"""

from __future__ import annotations

import math

import numpy as np

from haptic_driver.render.texture import Grating, Placed, Profile, Texture
from haptic_driver.signals import Array
from haptic_driver.textures.description import FINEST_MM, GratingDescription, NoiseDescription
from haptic_driver.textures.objects import TEXTURE_COF

FINEST_M = FINEST_MM * 1e-3
PHASE_BITS = 53  # of a float's mantissa


def grating(described: GratingDescription) -> Texture:
    """Sine, square or sawtooth; phase 0 is where friction rises through the middle.

    Square and sawtooth are straight lines with edges as wide as the finest detail. An edge is a
    sudden step averaged over that width.
    """
    mean, amplitude, period_m = (
        described.mean_cof,
        described.amplitude_cof,
        described.period_mm * 1e-3,
    )
    direction_rad, phase_rad = (
        math.radians(described.direction_deg),
        math.radians(described.phase_deg),
    )
    if described.wave == "sine":
        return Grating(mean, amplitude, period_m, direction_rad, phase_rad)
    corners_m, levels = (_square if described.wave == "square" else _sawtooth)(
        period_m, described.share()
    )
    shift_m = phase_rad / math.tau * period_m
    wave = Profile(
        [c - shift_m for c in corners_m], [mean + amplitude * level for level in levels], "tile"
    )
    return wave if direction_rad == 0.0 else Placed(wave, rotation_rad=direction_rad)


def _square(period_m: float, duty: float) -> tuple[list[float], list[float]]:
    half_edge_m, fall_m = 0.5 * FINEST_M, duty * period_m
    corners_m = [
        -half_edge_m,
        half_edge_m,
        fall_m - half_edge_m,
        fall_m + half_edge_m,
        period_m - half_edge_m,
    ]
    return corners_m, [-1.0, 1.0, 1.0, -1.0, -1.0]


def _sawtooth(period_m: float, duty: float) -> tuple[list[float], list[float]]:
    rise_m = min(max(duty * period_m, FINEST_M), period_m - FINEST_M)
    return [-0.5 * rise_m, 0.5 * rise_m, period_m - 0.5 * rise_m], [-1.0, 1.0, -1.0]


def noise(described: NoiseDescription) -> Array:
    """One tile [rows, columns]: waves of equal height, all those of the band that fit the tile a
    whole number of times.

    Scaled so that the largest deviation from the mean is the amplitude. Phases are in the order of
    the wave vectors.
    """
    tile_mm, count = described.tile_mm, described.pixels()
    most = math.floor(tile_mm / described.shortest_mm)
    waves = np.arange(-most, most + 1)
    phases_rad = random_phases_rad(described.seed, waves.size**2)
    per_tile = np.hypot(waves[:, None], waves[None, :])
    band = (per_tile >= tile_mm / described.longest_mm) & (
        per_tile <= tile_mm / described.shortest_mm
    )
    spectrum = np.zeros((count, count), dtype=complex)
    spectrum[np.ix_(waves, waves)] = np.where(
        band, np.exp(1j * phases_rad.reshape(band.shape)), 0.0
    )
    field = np.fft.ifft2(spectrum).real
    scaled: Array = described.mean_cof + described.amplitude_cof * field / np.abs(field).max()
    return scaled


def random_phases_rad(seed: int, count: int) -> Array:
    """Straight from the bits of PCG64: the stream that numpy keeps the same in every version (NEP
    19).
    """
    bits = np.random.PCG64(seed).random_raw(count)
    return np.asarray(math.tau * (bits >> np.uint64(64 - PHASE_BITS)) / 2.0**PHASE_BITS)


def amplified(position_m: Array, cof: Array, gain: float) -> Array:
    """Friction [n] over position whose deviation from its mean along the way is `gain` times as
    large, cut where a texture's friction ends.
    """
    if gain == 1.0:
        return cof
    way_m = np.diff(position_m)
    mean = float(np.sum(0.5 * (cof[1:] + cof[:-1]) * way_m) / way_m.sum())
    return np.asarray(np.clip(mean + gain * (cof - mean), *TEXTURE_COF))


def averaged(values: Array, pitch_x_m: float, pitch_y_m: float) -> tuple[Array, float, float]:
    """A map whose pixels are at least the finest detail wide, and its pitches: averages over the
    area, size unchanged.

    A finer map would be sampled by the ticks of a sliding finger at pixels picked by chance.
    """
    rows, pitch_y_m = _averaged_rows(values, pitch_y_m)
    columns, pitch_x_m = _averaged_rows(rows.T, pitch_x_m)
    return columns.T, pitch_x_m, pitch_y_m


def _averaged_rows(values: Array, pitch_m: float) -> tuple[Array, float]:
    count = len(values)
    fewer = max(1, math.floor(count * pitch_m / FINEST_M * (1.0 + 1e-9)))
    if fewer >= count:
        return values, pitch_m
    edges = np.linspace(0.0, count, fewer + 1)
    whole = np.minimum(edges.astype(np.intp), count - 1)
    before = np.concatenate([np.zeros((1, values.shape[1])), np.cumsum(values, axis=0)])
    area = before[whole] + (edges - whole)[:, None] * values[whole]
    average = np.diff(area, axis=0) / (count / fewer)
    return np.clip(average, values.min(), values.max()), pitch_m * count / fewer
