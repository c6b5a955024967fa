"""Distribution of the air gap under a rough finger (Persson's theory, paper eqs 41-49), as
histograms of the gap.

All lengths are in units of the rms roughness and all pressures in units of Y* q0 h_rms, so that one
set of histograms serves every finger with the same Hurst exponent. Each histogram is the exact bin
mass of the mixture of folded normals (48); each component is one slice of contact area lost between
two magnifications, placed at the mean separation of that slice, d(mean gap x area)/d(area), which
conserves the mean gap however coarse the slices are.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy import special

GAMMA = 0.45  # elastic correction factor, paper App. D
GAP_SCALE = (
    1e-4  # below this gap (in units of h_rms) bins are evenly spaced, above it geometrically
)
N_BINS = 220
N_PRESSURES = 44
N_SLICES = 420
N_NODES = 48  # Gauss-Legendre nodes of the mean-gap integral


@dataclass(frozen=True)
class GapHistograms:
    """Bin masses over the gap for a ladder of pressures (dimensionless); rows of `mass` add up to 1
    - A_real/A0.
    """

    log_pressure: np.ndarray
    gap: np.ndarray
    mass: np.ndarray
    area: np.ndarray
    mean_gap: np.ndarray

    def at(self, pressure: np.ndarray) -> np.ndarray:
        """Masses (n, bins) at dimensionless `pressure` (n,): four-point Lagrange interpolation in
        log pressure.
        """
        ladder = self.log_pressure
        step = ladder[1] - ladder[0]
        place = (np.log(pressure) - ladder[0]) / step
        first = np.clip(np.floor(place).astype(int) - 1, 0, ladder.size - 4)
        x = np.clip(place, 0.0, ladder.size - 1.0) - first
        weights = np.zeros((x.size, ladder.size))
        rows = np.arange(x.size)
        weights[rows, first] = -(x - 1) * (x - 2) * (x - 3) / 6
        weights[rows, first + 1] = x * (x - 2) * (x - 3) / 2
        weights[rows, first + 2] = -x * (x - 1) * (x - 3) / 2
        weights[rows, first + 3] = x * (x - 1) * (x - 2) / 6
        return weights @ self.mass


@lru_cache(maxsize=1)
def _pressure_integral() -> tuple[np.ndarray, np.ndarray]:
    """Inner integral of (45) over x from x0 to infinity, tabulated against log x0."""
    log_x = np.linspace(np.log(1e-9), np.log(6.5), 6000)
    x = np.exp(log_x)
    integrand = (GAMMA + 3 * (1 - GAMMA) * special.erf(x) ** 2) * np.exp(-(x**2))
    pieces = 0.5 * (integrand[1:] + integrand[:-1]) * np.diff(log_x)
    tail = np.concatenate([np.cumsum(pieces[::-1])[::-1], [0.0]])
    return log_x, tail


def _mean_gap(
    pressure: float, zeta: np.ndarray, area: np.ndarray, hurst: float, top: float
) -> np.ndarray:
    """Mean separation (45) in units of h_rms at each magnification, all finer roughness
    included.
    """
    power = 2 - 2 * hurst
    local = pressure / area
    # y = x/zeta - 1; the integrand is nil (x0 > 6) below the first bound
    level = (local / 6.0) ** 2 * power / hurst / zeta**power
    low = np.log(np.expm1(np.log1p(level) / power))
    high = np.log(top / zeta - 1)
    nodes, weights = np.polynomial.legendre.leggauss(N_NODES)
    span = np.maximum(high - low, 0.0)[:, None]
    y = np.exp(low[:, None] + 0.5 * span * (nodes + 1))
    slope = hurst / power * zeta[:, None] ** power * np.expm1(power * np.log1p(y))
    log_x, tail = _pressure_integral()
    inner = np.interp(np.log(local[:, None]) - 0.5 * np.log(slope), log_x, tail)
    x = zeta[:, None] * (1 + y)
    integrand = x ** (-2 * hurst) / np.sqrt(slope) * inner * zeta[:, None] * y
    return hurst / np.sqrt(np.pi) * (integrand * weights * 0.5 * span).sum(axis=1)


def _edges() -> np.ndarray:
    return GAP_SCALE * np.sinh(np.linspace(0.0, np.arcsinh(25.0 / GAP_SCALE), N_BINS + 1))


def _one_pressure(pressure: float, hurst: float, top: float) -> tuple[np.ndarray, float, float]:
    power = 2 - 2 * hurst
    # slices where the area falls by equal shares of -log(area), from full contact to the cut-off
    depth = np.linspace(
        np.log(pressure) - np.log(5.5), 0.5 * np.log(hurst / power * (top**power - 1)), N_SLICES
    )
    zeta = np.exp(np.log1p(np.exp(2 * depth) * power / hurst) / power)
    zeta[-1] = top * (1 - 1e-9)
    area = special.erf(pressure / np.sqrt(hurst / power * np.expm1(power * np.log(zeta))))
    mean = _mean_gap(pressure, zeta, area, hurst, top)
    lost = area[:-1] - area[1:]
    centre = np.maximum(
        (mean[:-1] * area[:-1] - mean[1:] * area[1:]) / np.maximum(lost, 1e-300), 0.0
    )
    middle = np.sqrt(zeta[:-1] * zeta[1:])
    width = np.sqrt(middle ** (-2 * hurst) - top ** (-2 * hurst))
    edges = _edges()
    scaled = np.sqrt(0.5) / width[:, None]
    cumulative = 0.5 * (
        special.erf((edges - centre[:, None]) * scaled)
        + special.erf((edges + centre[:, None]) * scaled)
    )
    return lost @ np.diff(cumulative, axis=1), area[-1], mean[0]


@lru_cache(maxsize=4)
def histograms(hurst: float, top: float) -> GapHistograms:
    """Histograms for Hurst exponent `hurst` and cut-off ratio `top` = q1/q0 (about two seconds,
    then cached).
    """
    ladder = np.linspace(np.log(2e-4), np.log(8.0), N_PRESSURES)
    rows = [_one_pressure(float(np.exp(step)), hurst, top) for step in ladder]
    edges = _edges()
    mass, area, mean = (np.array(column) for column in zip(*rows, strict=True))
    return GapHistograms(ladder, 0.5 * (edges[1:] + edges[:-1]), mass, area, mean)
