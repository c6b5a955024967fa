"""Persson's contact of a rough finger with a flat screen: real area and distribution of gaps.

Equations (41)-(49) of AliAbbasi et al. 2022, dimensionless (see `roughness`). A pressure `p_hat` is
in units of Y* q0 h_rms, a gap in units of h_rms.

The mass of -A'(zeta) lies at zeta -> 1 (A/A0 is 0.008 at zeta = 1.1 for a light touch). The
smallest gaps lie at zeta -> zeta1. So the magnification runs on a logistic grid that resolves both
ends. The derivative in (44) is taken under the integral, never by differences.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from math import pi, sqrt

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.special import erf, exp1

from model.contact.resolution import LOGISTIC_END, S_NODES, X_NEGLIGIBLE, ZETA_MINUS_ONE_LOW
from model.contact.roughness import SelfAffineShape
from model.support.arrays import Array

ZETA_STEP = 0.1  # of the logistic variable; halving it moves no gap integral by more than 1e-6


@dataclass(frozen=True)
class GapDistribution:
    """Gaps of one contact as a mixture of folded normals, one per magnification (48).

    `weight` [n] is the share of the nominal area that leaves contact at each magnification (sums to
    1 - `area_ratio`). `separation` [n] is u1 of (44); `spread` [n] is h_rms(zeta) of (49). Lengths
    in units of h_rms.
    """

    area_ratio: float
    mean_gap: float
    weight: Array
    separation: Array
    spread: Array

    def density(self, u: Array) -> Array:
        """P(u) of (48) per unit of h_rms; `u` [m] >= 0, result [m]."""
        a = (u[:, None] - self.separation) / self.spread
        b = (u[:, None] + self.separation) / self.spread
        kernels = np.exp(-0.5 * a * a) + np.exp(-0.5 * b * b)
        return np.asarray(kernels @ (self.weight / (sqrt(2.0 * pi) * self.spread)))


def area_ratio(shape: SelfAffineShape, p_hat: Array | float) -> Array:
    """A_real/A0 of (42) at full magnification."""
    return np.asarray(erf(np.asarray(p_hat) / shape.full_contact))


def gap_distribution(
    shape: SelfAffineShape, p_hat: float, step: float = ZETA_STEP
) -> GapDistribution:
    """The distribution of gaps (48) under the pressure `p_hat` > 0.

    `step` is the spacing of the magnification grid; the rule is the trapezoid rule in a logistic
    variable, which converges exponentially for these integrands.
    """
    zeta, dzeta_dt, remaining = _magnifications(shape, step)
    moment = shape.moment3(zeta)
    y = p_hat / np.sqrt(shape.hurst * moment)
    leaving = y < X_NEGLIGIBLE  # below, the contact is still complete and nothing leaves it
    zeta, dzeta_dt, remaining, moment, y = (
        v[leaving] for v in (zeta, dzeta_dt, remaining, moment, y)
    )
    area = erf(y)
    # A'(zeta) < 0
    area_slope = -np.exp(-y * y) / sqrt(pi) * y * zeta ** (1.0 - 2.0 * shape.hurst) / moment
    two_h = 2.0 * shape.hurst
    spread = np.sqrt(zeta**-two_h * -np.expm1(two_h * np.log1p(-remaining / shape.zeta1)))
    return GapDistribution(
        area_ratio=float(area_ratio(shape, p_hat)),
        mean_gap=mean_gap(shape, p_hat),
        weight=-area_slope * dzeta_dt * step,
        separation=_separations(shape, p_hat, zeta, area, area_slope),
        spread=spread,
    )


def _magnifications(shape: SelfAffineShape, step: float) -> tuple[Array, Array, Array]:
    """zeta, d zeta/dt and zeta1 - zeta on the logistic grid zeta = 1 + (zeta1 - 1)/(1 + e^-t)."""
    span = shape.zeta1 - 1.0
    t = np.arange(np.log(ZETA_MINUS_ONE_LOW / span), LOGISTIC_END, step)
    above, below = span / (1.0 + np.exp(-t)), span / (1.0 + np.exp(t))
    return 1.0 + above, above * below / span, below


def mean_gap(shape: SelfAffineShape, p_hat: float) -> float:
    """Mean separation of the whole contact: (45) at zeta = 1, where nothing has left contact
    yet.
    """
    if shape.full_contact <= p_hat / X_NEGLIGIBLE:
        return 0.0  # pressed flat
    return float(_SeparationRule.at(shape, np.ones(1), np.array([p_hat])).mean()[0])


def _separations(
    shape: SelfAffineShape, p_hat: float, zeta: Array, area: Array, area_slope: Array
) -> Array:
    """u1 of (44) at each magnification; 0 where the surfaces touch at every smaller scale."""
    k, h = 2.0 - 2.0 * shape.hurst, shape.hurst
    p_zeta = p_hat / area
    open_ = h * (shape.zeta1**k - zeta**k) / k > (p_zeta / X_NEGLIGIBLE) ** 2
    rule = _SeparationRule.at(shape, zeta[open_], p_zeta[open_])
    separation = np.zeros_like(zeta)
    separation[open_] = (
        rule.mean() + rule.by_pressure() + rule.by_scale() * (area / area_slope)[open_]
    )
    return separation


@dataclass(frozen=True)
class _SeparationRule:
    """Gauss-Legendre rule for (45) and its derivative, in log S.

    The variable is S = (s q0 h_rms)^-2, with x^(2-2H) = zeta^(2-2H) + (2-2H) S/H and x0 =
    p(zeta)/sqrt(S). Then u = 1/sqrt(pi) int_0^S1 dS S^-1/2 I(x0)/x. Its derivative by zeta has
    three parts: p(zeta), x and the limit S1.
    """

    shape: SelfAffineShape
    zeta: Array  # [n]
    s1: Array  # [n]
    p_zeta: Array  # [n]
    x: Array  # [n, nodes]
    x0: Array  # [n, nodes]
    weight: Array  # [n, nodes], of dS S^-1/2 / sqrt(pi)
    inner: Array  # [n, nodes], I(x0)

    @classmethod
    def at(cls, shape: SelfAffineShape, zeta: Array, p_zeta: Array) -> _SeparationRule:
        k, h = 2.0 - 2.0 * shape.hurst, shape.hurst
        s1 = h * (shape.zeta1**k - zeta**k) / k
        s_low = (p_zeta / X_NEGLIGIBLE) ** 2
        nodes, gauss = _gauss_legendre()
        half = 0.5 * np.log(s1 / s_low)
        s = np.exp(0.5 * np.log(s1 * s_low)[:, None] + half[:, None] * nodes)
        x = (zeta[:, None] ** k + k * s / h) ** (1.0 / k)
        x0 = p_zeta[:, None] / np.sqrt(s)
        weight = gauss * half[:, None] * np.sqrt(s / pi)
        return cls(shape, zeta, s1, p_zeta, x, x0, weight, _inner_integral(shape.gamma, x0))

    def mean(self) -> Array:
        return np.asarray(np.sum(self.weight / self.x * self.inner, axis=1))

    def by_pressure(self) -> Array:
        """Part of u' A/A' that comes through p(zeta) = p A0/A."""
        return np.asarray(
            np.sum(self.weight / self.x * _inner_integrand(self.shape.gamma, self.x0), axis=1)
        )

    def by_scale(self) -> Array:
        """Part of u' that comes through x and through the limit S1."""
        h = self.shape.hurst
        at_limit = _inner_integral(self.shape.gamma, self.p_zeta / np.sqrt(self.s1))
        limit = h / (self.shape.zeta1 * np.sqrt(pi * self.s1)) * at_limit
        through_x = np.sum(self.weight * self.x ** (2.0 * h - 3.0) * self.inner, axis=1)
        return np.asarray(-(self.zeta ** (1.0 - 2.0 * h)) * (limit + through_x))


@lru_cache(maxsize=1)
def _gauss_legendre() -> tuple[Array, Array]:
    """Nodes and weights on -1..1; read only."""
    return np.polynomial.legendre.leggauss(S_NODES)


def _inner_integrand(gamma: float, x: Array) -> Array:
    return np.asarray((gamma + 3.0 * (1.0 - gamma) * erf(x) ** 2) * np.exp(-x * x))


def _inner_integral(gamma: float, x0: Array) -> Array:
    """I(x0) = int_x0^inf [gamma + 3(1-gamma) erf^2(x)] exp(-x^2)/x dx, the inner integral of
    (45).
    """
    return np.asarray(
        gamma * 0.5 * exp1(x0 * x0) + 3.0 * (1.0 - gamma) * _erf_squared_tail()(np.log(x0))
    )


@lru_cache(maxsize=1)
def _erf_squared_tail() -> CubicSpline:
    """int_x0^inf erf^2(x) exp(-x^2)/x dx as a function of log x0; clamped outside the grid by its
    own limits.
    """
    grid = np.linspace(np.log(1e-12), np.log(12.0), 6001)
    x = np.exp(grid)
    antiderivative = CubicSpline(grid, erf(x) ** 2 * np.exp(-x * x)).antiderivative()
    return CubicSpline(grid, antiderivative(grid[-1]) - antiderivative(grid))
