"""One rough contact solved point by point: a random self-affine surface pressed flat by a
boundary-element solver.

The solver is tamaas (Polonsky and Keer 1999, FFT-accelerated, periodic, without adhesion); the
surface is made here, so that one surface can be sampled at several resolutions.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import pi

import numpy as np
import tamaas
from numpy.typing import NDArray

from model.contact.roughness import Array, SelfAffineShape

# wavelengths 2 pi/q0 along one side: enough for the mean of a few surfaces, few enough for the grid
LONGEST_WAVES = 4
TOLERANCE = 1e-8  # of the solver; 1e-10 moves no ratio by 1e-5


@dataclass(frozen=True)
class RoughContact:
    """A contact as the theory knows it: shape of the roughness, h_rms in m, q0 in 1/m, Y* in Pa."""

    shape: SelfAffineShape
    h_rms_m: float = 20e-6
    q0_per_m: float = 1e3
    modulus_pa: float = 13.33e6

    @property
    def pressure_scale_pa(self) -> float:
        """Y* q0 h_rms: the theory knows a pressure in this unit alone."""
        return self.modulus_pa * self.q0_per_m * self.h_rms_m


@dataclass(frozen=True)
class SolvedContact:
    """Gaps [n, n] in m and where the surfaces touch [n, n], under one nominal pressure."""

    pressure_pa: float
    gap_m: Array
    touching: NDArray[np.bool_]

    @property
    def area_ratio(self) -> float:
        """Share of the points that carry pressure."""
        return float(self.touching.mean())

    @property
    def mean_gap_m(self) -> float:
        """Mean over the whole nominal area, contact included."""
        return float(self.gap_m.mean())

    def inverse_square_per_m2(self, length_m: float) -> float:
        """Integral of P(u)/(u + h)^2 over the gaps: the mean over the nominal area, with nothing
        from the contact.
        """
        return float(np.where(self.touching, 0.0, 1.0 / (self.gap_m + length_m) ** 2).mean())


def random_surface(contact: RoughContact, seed: int, points: int) -> Array:
    """Heights [points, points] in m with spectrum (41) from q0 to q1, random phases, rms exactly
    h_rms.

    The waves are drawn before the grid is chosen: the same seed gives the same surface at every
    resolution.
    """
    longest, shortest = LONGEST_WAVES, round(LONGEST_WAVES * contact.shape.zeta1)
    if points < 2 * shortest + 1:
        raise ValueError(
            f"{points} points cannot hold {shortest} waves; give at least {2 * shortest + 1}"
        )
    k = np.arange(-shortest, shortest + 1)
    wave = np.hypot(k[:, None], k[None, :])
    rough = (wave >= longest) & (wave <= shortest)
    amplitude = np.where(rough, np.maximum(wave, 1.0) ** (-1.0 - contact.shape.hurst), 0.0)
    phase = np.random.default_rng(seed).uniform(0.0, 2.0 * pi, wave.shape)
    waves = amplitude * np.exp(1j * phase)
    spectrum = np.zeros((points, points), dtype=np.complex128)
    spectrum[np.ix_(k % points, k % points)] = waves + waves[::-1, ::-1].conj()  # real heights
    heights = np.fft.ifft2(spectrum).real
    return np.asarray(heights * (contact.h_rms_m / heights.std()))


def solve(contact: RoughContact, heights_m: Array, pressure_pa: float) -> SolvedContact:
    """Press `heights_m` against a flat with the nominal pressure; raises RuntimeError where the
    solver gives up.

    Solved in units of h_rms and 1/q0: pressures are then in units of Y* q0 h_rms.
    """
    side = LONGEST_WAVES * 2.0 * pi
    model = tamaas.ModelFactory.createModel(
        tamaas.model_type.basic_2d, [side, side], list(heights_m.shape)
    )
    model.E, model.nu = 1.0, 0.0
    solver = tamaas.PolonskyKeerRey(model, heights_m / contact.h_rms_m, TOLERANCE)
    solver.max_iter = 5000
    error = solver.solve(pressure_pa / contact.pressure_scale_pa)
    if not error < TOLERANCE * 1.01:
        raise RuntimeError(
            f"the contact at {pressure_pa:g} Pa did not converge (error {error:.1e})"
        )
    return SolvedContact(
        pressure_pa, np.maximum(model["gap"], 0.0) * contact.h_rms_m, model.traction > 0.0
    )
