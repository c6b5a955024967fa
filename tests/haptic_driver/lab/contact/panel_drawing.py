"""Capacitive frames of known contacts: ellipses of full coverage seen through a panel's own spread.

The spread is exponential and not Gaussian, as the field above a panel falls off, and it is summed
on a grid much finer than cells. Nothing here is shared with the code under test.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.signal import fftconvolve

ROWS, COLUMNS, PITCH_M = 20, 16, 4.5e-3
FINER = 15
STEP_M = PITCH_M / FINER
FALL_M = 1.6e-3
FULL_COUNTS = 480.0


@dataclass(frozen=True)
class Ellipse:
    """A contact: its area, its axes' ratio, its turn, and its centre in cells from the corner."""

    area_m2: float
    ratio: float = 1.3
    turn_rad: float = 0.4
    row: float = 9.7
    column: float = 7.2


def _kernel() -> np.ndarray:
    reach = round(6.0 * FALL_M / STEP_M)
    at_m = np.arange(-reach, reach + 1) * STEP_M
    spread = np.exp(-np.hypot(at_m[:, None], at_m) / FALL_M)
    return spread / spread.sum()


def drawn(*contacts: Ellipse) -> np.ndarray:
    """Counts [row, column] without noise, FULL_COUNTS under a contact that has no end."""
    y, x = ((np.indices((ROWS * FINER, COLUMNS * FINER)) + 0.5) / FINER - 0.5) * PITCH_M
    covered = np.zeros(y.shape)
    for one in contacts:
        long_m = np.sqrt(one.area_m2 * one.ratio / np.pi)
        c, s = np.cos(one.turn_rad), np.sin(one.turn_rad)
        v, u = y - one.row * PITCH_M, x - one.column * PITCH_M
        along, across = (c * u + s * v) / long_m, (c * v - s * u) / (long_m / one.ratio)
        covered[along**2 + across**2 <= 1.0] = 1.0
    seen = fftconvolve(covered, _kernel(), mode="same")
    cells = seen.reshape(ROWS, FINER, COLUMNS, FINER).mean(axis=(1, 3))
    return np.maximum(FULL_COUNTS * cells, 0.0)


def noisy(counts: np.ndarray, random: np.random.Generator, std_counts: float = 4.0) -> np.ndarray:
    """Whole counts, as a panel sends them."""
    return np.round(counts + random.normal(0.0, std_counts, counts.shape)).astype(np.int16)


def any_contact(
    random: np.random.Generator, low_m2: float = 35e-6, high_m2: float = 220e-6
) -> Ellipse:
    """Of an area in that range, anywhere inside the panel."""
    return Ellipse(
        area_m2=float(np.exp(random.uniform(np.log(low_m2), np.log(high_m2)))),
        ratio=float(random.uniform(1.0, 1.7)),
        turn_rad=float(random.uniform(0.0, np.pi)),
        row=float(random.uniform(5.0, 14.0)),
        column=float(random.uniform(5.0, 10.0)),
    )
