"""The whole chain once more by numerical integration (mpmath), at random touches: 0.1 % of the
pressure.

Shared with the source are the numbers of the touch alone. The distribution of gaps comes from
(41)-(49) by brute quadrature and differences; the field of every gap is that of impedances in
series, with the leak beside the air; the integral over the gaps and (40) are mpmath's.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import mpmath
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.special import erf, erfc

from model.conditions import Conditions
from model.touch_model import TouchModel

EPS0 = 8.8541878128e-12  # F/m, CODATA 2018
SHAPES = 1  # roughness shapes drawn besides the shipped ones, each of which needs a gap table
POINTS = 20
MORE_POINTS = 40


@dataclass(frozen=True)
class Touch:
    """One drawn condition and what of the roughness and the layers is drawn with it."""

    frequency_hz: float
    voltage_v: float
    normal_force_n: float
    parameters: dict[str, float]


def draw(rng: np.random.Generator, hurst: float, zeta1: float) -> Touch:
    """A touch of the roughness shape (H, q1/q0); the attraction stays in the range of the
    theory.
    """
    # by powers of two, so that q1/q0 is the same to the last bit: one gap table
    q0 = 1e3 * 2.0 ** int(rng.integers(0, 4))
    return Touch(
        frequency_hz=float(np.exp(rng.uniform(np.log(1.0), np.log(1e6)))),
        voltage_v=float(rng.uniform(5.0, 120.0)),
        normal_force_n=float(np.exp(rng.uniform(np.log(0.1), np.log(2.0)))),
        parameters={
            "hurst_exponent": hurst,
            "roll_off_wavenumber_per_m": q0,
            "cut_off_wavenumber_per_m": q0 * zeta1,
            "roughness_rms_m": float(rng.uniform(8e-6, 40e-6)),
            "skin_modulus_pa": float(rng.uniform(3e6, 3e7)),
            "insulator_thickness_m": float(rng.uniform(0.3e-6, 3e-6)),
            "skin_thickness_m": float(rng.uniform(80e-6, 350e-6)),
            "leak_scale": float(rng.uniform(0.0, 3.0)),
        },
    )


def touches(seed: int, shapes: int, points: int) -> list[Touch]:
    """Points spread over the shapes: the two shipped ones, then drawn ones."""
    rng = np.random.default_rng(seed)
    known = [(0.71, 1e7), (0.86, 1.25e6)]
    drawn = [
        (float(rng.uniform(0.6, 0.9)), float(np.exp(rng.uniform(np.log(1e4), np.log(1e8)))))
        for _ in range(shapes)
    ]
    every = known + drawn
    return [draw(rng, *every[i % len(every)]) for i in range(points)]


@pytest.fixture(scope="module")
def slow_pressure(printed_theory):
    """p_e of (29) with |E|^2/2, at the total pressure p, by mpmath over the gaps."""

    def pressure(model: TouchModel, touch: Touch, p: float) -> float:
        theory, v = printed_theory(model), model.description.values
        density = gap_density(theory, p)
        omega = 2.0 * np.pi * touch.frequency_hz
        k2 = dry_skin(omega)
        sigma_skin = -k2.imag * omega * EPS0
        leak = (
            touch.parameters["leak_scale"]
            * 2.0
            * sigma_skin
            * p
            / (theory.Y * characteristic_length(theory))
        )
        behind = v.insulator_thickness_m / (1j * omega * EPS0 * 3.9 + 1e-13)
        behind += v.skin_thickness_m / (1j * omega * EPS0 * k2)

        def integrand(log_u: mpmath.mpf) -> float:
            u = float(mpmath.exp(log_u))
            gap = 1.0 / ((1j * omega * EPS0 + 1e-14) / u + leak)
            field = gap / (gap + behind) / u
            return float(abs(field) ** 2 * density(u) * u)

        ends = np.linspace(np.log(1e-13 * theory.h_rms), np.log(60.0 * theory.h_rms), 26)
        total = float(mpmath.quad(integrand, ends.tolist(), method="gauss-legendre", maxdegree=3))
        return 0.25 * EPS0 * touch.voltage_v**2 * total

    return pressure


def dry_skin(omega: float) -> complex:
    """Gabriel et al. 1996, dry skin, from the published constants."""
    jw = mpmath.mpc(0.0, omega)
    k = 4 + 32 / (1 + jw * 7.23e-12) + 1100 / (1 + (jw * 32.48e-9) ** 0.8) + 2e-4 / (jw * EPS0)
    return complex(k)


def characteristic_length(theory: Any) -> float:
    """L0 of (39) with (40) as an integral, x = 1 + y^2."""
    h = theory.H
    integral = mpmath.quad(
        lambda y: 2 * (1 + y * y) ** (-1 / (2 * (1 - mpmath.mpf(h)))), [0, 1, mpmath.inf]
    )
    r = h / (2.0 * (1.0 - h)) * float(integral)
    return float(
        np.sqrt(2.0 * (1.0 - h) / (np.pi * h)) * theory.h_rms * (r - (theory.q0 / theory.q1) ** h)
    )


def gap_density(theory: Any, p: float):
    """P(u) of (48) in 1/m: one folded normal per magnification, on Gauss nodes in log(zeta - 1)."""
    x, gauss = np.polynomial.legendre.leggauss(6)
    edges = np.linspace(np.log(1e-13), np.log(theory.q1 / theory.q0 - 1.0), 46)
    half = 0.5 * np.diff(edges)[:, None]
    tau, dtau = (edges[:-1, None] + half * (x + 1.0)).ravel(), (half * gauss).ravel()
    leaving = theory.stress_ratio(p, tau) < 5.0  # erfc(5) = 1.5e-12 of the area is left out
    tau, dtau = tau[leaving], dtau[leaving]
    step = 1e-3  # central differences: step^2/6 = 2e-7 of a derivative
    lost = (erfc(theory.stress_ratio(p, tau + step)) - erfc(theory.stress_ratio(p, tau - step))) / (
        2.0 * step
    )
    area = erf(theory.stress_ratio(p, tau))
    before, u, after = (
        theory.mean_separation(p / erf(theory.stress_ratio(p, t)), t)
        for t in (tau - step, tau, tau + step)
    )
    u1 = u - (after - before) / (2.0 * step) * area / lost  # (44)
    q = theory.q0 * (1.0 + np.exp(tau))
    spread = np.sqrt(2.0 * np.pi * theory.moment(1, q, np.log(theory.q1 / q)))  # (49)
    weight = lost * dtau / (np.sqrt(2.0 * np.pi) * spread)

    def density(gap: float) -> float:
        folded: NDArray[np.float64] = np.exp(-0.5 * ((gap - u1) / spread) ** 2) + np.exp(
            -0.5 * ((gap + u1) / spread) ** 2
        )
        return float(folded @ weight)

    return density


def check(variant, slow_pressure, touch: Touch) -> None:
    model = variant(**touch.parameters)
    f, v, n = (np.array([x]) for x in (touch.frequency_hz, touch.voltage_v, touch.normal_force_n))
    p_e = float(model.predict(Conditions(f, v, n)).electrostatic_force_n[0]) / 1e-4
    assert p_e > 0.0
    again = slow_pressure(model, touch, touch.normal_force_n / 1e-4 + p_e)
    assert p_e == pytest.approx(again, rel=1e-3), touch


@pytest.mark.parametrize("touch", touches(1, SHAPES, POINTS))
def test_pressure_at_random_touches(variant, slow_pressure, touch):
    check(variant, slow_pressure, touch)


@pytest.mark.soak
@pytest.mark.parametrize("touch", touches(2, 12, MORE_POINTS))
def test_pressure_at_more_random_touches(variant, slow_pressure, touch):
    check(variant, slow_pressure, touch)
