"""The model against the authors' way of computing: nested quadrature at every point. Same points,
one run, by turns.

The slow side shares nothing with the model but its parameters: equations (24)-(31) as corrected in
docs/physics.md and (41)-(49) of AliAbbasi et al. 2022 in SI units, every integral by
`scipy.integrate.quad`, the loop closed by iteration.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from math import erf, exp, expm1, inf, log, log1p, pi, sqrt

import numpy as np
from scipy.integrate import quad
from scipy.interpolate import CubicSpline
from scipy.special import gamma as gamma_function

from benchmarks.claim import Claim
from haptic_driver.lookup.models import load_model
from model.conditions import Conditions
from model.parameters import TouchParameters
from model.touch_model import TouchModel

EPS0 = 8.8541878128e-12
POINTS = ((250.0, 75.0, 0.5), (1e4, 120.0, 1.0))  # Hz, V, N
NODES = 100  # of magnification, even in log(zeta - 1)
NOTHING = 6.0  # exp(-36) = 2e-16
COMPLETE = 4.5  # p/(2 sqrt G) beyond which contact is complete: 2e-10 of the area
LOOP_CLOSED = 1e-5
TURNS = 300  # of the model per turn of the slow algorithm


@dataclass(frozen=True)
class Published:
    """One finger on one screen."""

    p: TouchParameters

    def force_n(self, frequency_hz: float, voltage_v: float, normal_force_n: float) -> float:
        """Electrostatic force of a sine, p = p0 + p_e by iteration."""
        load = normal_force_n / self.p.contact_area_m2
        p_e, before = 0.0, inf
        while abs(p_e - before) > LOOP_CLOSED * p_e:
            before = p_e
            p_e = self.pressure_pa(frequency_hz, voltage_v, load + p_e)
        return p_e * self.p.contact_area_m2

    def pressure_pa(self, frequency_hz: float, voltage_v: float, pressure: float) -> float:
        """(28)-(30): (eps0/4) V^2 int P(u) / |a u + b|^2 du, with P(u) of (48) under the total
        `pressure`.
        """
        p, jw_eps0 = self.p, 2j * pi * frequency_hz * EPS0
        skin = dry_skin(frequency_hz)
        h = p.insulator_thickness_m / (
            p.insulator_permittivity + p.insulator_conductivity_s_per_m / jw_eps0
        )
        h += p.skin_thickness_m / skin
        conductivity = -skin.imag * 2.0 * pi * frequency_hz * EPS0
        alpha = (
            p.leak_scale
            * 2.0
            * conductivity
            * pressure
            / (p.effective_modulus_pa * self.contact_length_m())
        )
        a, b = 1.0 + alpha * h / jw_eps0, (1.0 + p.air_conductivity_s_per_m / jw_eps0) * h
        return EPS0 / 4.0 * voltage_v**2 * self.mean_over_gaps(pressure, a, b)

    def mean_over_gaps(self, pressure: float, a: complex, b: complex) -> float:
        """int P(u) / |a u + b|^2 du: at every magnification an integral over gaps."""
        start = log(
            (pressure / (COMPLETE * self.p.effective_modulus_pa)) ** 2 / self.slope_variance(1.0)
        )
        tau = np.linspace(start, log(self.zeta1 - 1.0) - 1e-6, NODES)
        zeta, ratio = 1.0 + np.exp(tau), np.array([self.stress_ratio(pressure, t) for t in tau])
        area = np.array([erf(r) for r in ratio])
        # dA/dtau = 2/sqrt(pi) exp(-r^2) dr/dtau, by (42)
        lost = (
            2.0 / sqrt(pi) * np.exp(-(ratio**2)) * -CubicSpline(tau, np.log(ratio))(tau, 1) * ratio
        )
        mean = np.array(
            [self.mean_separation(z, pressure / share) for z, share in zip(zeta, area, strict=True)]
        )
        separation = mean - CubicSpline(tau, mean)(tau, 1) * area / lost  # (44)
        over_gaps = [
            self._at_magnification(z, u1, a, b) for z, u1 in zip(zeta, separation, strict=True)
        ]
        return float(CubicSpline(tau, lost * over_gaps).integrate(tau[0], tau[-1]))

    def _at_magnification(self, zeta: float, u1: float, a: complex, b: complex) -> float:
        """The integrand of (48) over all gaps, in log u."""
        spread = sqrt(max(self.height_variance(zeta), 1e-300))  # (49)

        def integrand(log_u: float) -> float:
            u = exp(log_u)
            folded = exp(-0.5 * ((u - u1) / spread) ** 2) + exp(-0.5 * ((u + u1) / spread) ** 2)
            return u * folded / (sqrt(2.0 * pi) * spread * abs(a * u + b) ** 2)

        high = abs(u1) + 8.0 * spread
        low = u1 - 8.0 * spread if u1 > 9.0 * spread else 1e-7 * min(spread, abs(b / a))
        return float(quad(integrand, log(low), log(high), epsabs=0.0, epsrel=1e-6, limit=200)[0])

    def mean_separation(self, zeta: float, pressure: float) -> float:
        """(45), the outer integral in log log(q/(zeta q0)), the inner one from `_inner`; (46),
        (47).
        """
        p, low = self.p, zeta * self.p.roll_off_wavenumber_per_m
        width = log(self.zeta1 / zeta)
        least = (pressure / (NOTHING * p.effective_modulus_pa)) ** 2 / (
            pi * low**4 * self.spectrum(low)
        )

        def integrand(log_y: float) -> float:
            y = exp(log_y)
            q = low * exp(y)
            w = (pi * self.moment3(low, y)) ** -0.5
            return float(
                y * q**3 * self.spectrum(q) * w * self._inner(w * pressure / p.effective_modulus_pa)
            )

        if least >= width:
            return 0.0
        return float(
            sqrt(pi)
            * quad(integrand, log(least), log(width), epsabs=0.0, epsrel=1e-6, limit=200)[0]
        )

    def _inner(self, x0: float) -> float:
        """int [gamma + 3(1 - gamma) erf^2(x)] exp(-x^2)/x dx from `x0`, in log x."""
        if x0 >= NOTHING:
            return 0.0
        g = self.p.contact_gamma

        def integrand(log_x: float) -> float:
            x = exp(log_x)
            return (g + 3.0 * (1.0 - g) * erf(x) ** 2) * exp(-x * x)

        return float(quad(integrand, log(x0), log(NOTHING), epsabs=0.0, epsrel=1e-7, limit=200)[0])

    @property
    def zeta1(self) -> float:
        return self.p.cut_off_wavenumber_per_m / self.p.roll_off_wavenumber_per_m

    def spectrum(self, q: float) -> float:
        p = self.p
        relative = (q / p.roll_off_wavenumber_per_m) ** (-2.0 * (1.0 + p.hurst_exponent))
        return (
            p.hurst_exponent
            / pi
            * (p.roughness_rms_m / p.roll_off_wavenumber_per_m) ** 2
            * relative
        )

    def moment3(self, low: float, log_width: float) -> float:
        """int q^3 C dq from `low` to low e^log_width."""
        k = 2.0 - 2.0 * self.p.hurst_exponent
        return low**4 * self.spectrum(low) * expm1(k * log_width) / k

    def slope_variance(self, log_width: float) -> float:
        """pi int q^3 C dq from q0, for a narrow band the share of `log_width`."""
        q0 = self.p.roll_off_wavenumber_per_m
        return pi * q0**4 * self.spectrum(q0) * log_width

    def stress_ratio(self, pressure: float, tau: float) -> float:
        """p/(2 sqrt G) of (42)-(43) at zeta = 1 + e^tau; A/A0 is its erf."""
        moment = self.moment3(self.p.roll_off_wavenumber_per_m, log1p(exp(tau)))
        return pressure / (self.p.effective_modulus_pa * sqrt(pi * moment))

    def height_variance(self, zeta: float) -> float:
        """(49): 2 pi int q C dq from zeta q0 to q1."""
        two_h = 2.0 * self.p.hurst_exponent
        return self.p.roughness_rms_m**2 * zeta**-two_h * -expm1(-two_h * log(self.zeta1 / zeta))

    def contact_length_m(self) -> float:
        hurst = self.p.hurst_exponent
        s = hurst / (2.0 * (1.0 - hurst))
        r = s * gamma_function(0.5) * gamma_function(s) / gamma_function(s + 0.5)
        rest = r - self.zeta1**-hurst
        return float(sqrt(2.0 * (1.0 - hurst) / (pi * hurst)) * rest * self.p.roughness_rms_m)


def dry_skin(frequency_hz: float) -> complex:
    """Dry skin of Gabriel et al. 1996, Phys. Med. Biol. 41:2271."""
    jw = 2j * pi * frequency_hz
    relaxations = 32.0 / (1.0 + jw * 7.23e-12) + 1100.0 / (1.0 + (jw * 32.48e-9) ** 0.8)
    return complex(4.0 + relaxations + 2e-4 / (jw * EPS0))


def run() -> Iterator[Claim]:
    model = TouchModel(load_model("reference"))
    slow = Published(model.description.values)
    seconds_slow = seconds_fast = 0.0
    ratios = []
    model.predict(Conditions(*(np.array([x]) for x in POINTS[0])))  # compiled, and its table loaded
    for point in POINTS:
        start = time.perf_counter()
        expected = slow.force_n(*point)
        between = time.perf_counter()
        ask = partial(model.predict, Conditions(*(np.array([x]) for x in point)))
        answers = [ask() for _ in range(TURNS)]
        seconds_fast += (time.perf_counter() - between) / TURNS
        seconds_slow += between - start
        ratios.append(answers[0].electrostatic_force_n[0] / expected)
    conditions = Conditions(*np.repeat(np.array(POINTS).T, 500, axis=1))
    start = time.perf_counter()
    for _ in range(10):
        model.predict(conditions)
    in_batches = (time.perf_counter() - start) / 10 / conditions.voltage_v.size * len(POINTS)
    yield Claim(
        f"model against the published algorithm (nested quadrature), {len(POINTS)} points one"
        " by one",
        f"{seconds_slow / seconds_fast:,.0f} x ({seconds_slow / len(POINTS):.1f} s against "
        f"{1e6 * seconds_fast / len(POINTS):.0f} us per point)",
        "at least 1000 x",
        seconds_slow >= 1000.0 * seconds_fast,
    )
    yield Claim("the same points in batches of 1000", f"{seconds_slow / in_batches:,.0f} x")
    apart = float(np.max(np.abs(np.array(ratios) - 1.0)))  # NaN if any is
    yield Claim(
        "the two apart, electrostatic force",
        f"{100 * apart:.4f} % at most",
        "at most 0.2 %",
        apart <= 2e-3,
    )
