"""Closed form of the charges over time: (34)-(35) and appendix B of AliAbbasi et al. 2022.

With lambda and delta corrected or as printed.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import pi

import numpy as np

from model.electric.charges import Coefficients
from model.support.arrays import Array, Values


@dataclass(frozen=True)
class ClosedForm:
    """Charges under V0 cos(w t) from neutral layers, per volt: the coefficients of appendix B.

    The second "lambda" of the print is `delta`. w = 0 is direct current switched on.
    """

    coefficients: Coefficients
    omega: Values
    alpha: tuple[Values, Values]
    beta: tuple[Values, Values]
    eta: Values
    kappa: Values
    lambda_: Values
    delta: Values

    def charges(self, time_s: Array) -> tuple[Array, Array]:
        """rho1 and rho2 per volt, C/(m^2 V), at times that broadcast against the coefficients."""
        k, t = self.coefficients, np.asarray(time_s)
        half = 0.5 * (k.a + k.e)
        theta = np.sqrt((0.5 * (k.a - k.e)) ** 2 + k.b * k.d)
        # e^(-t half) cosh, sinh would overflow
        slow = np.exp(-t * (k.a * k.e - k.b * k.d) / (half + theta))
        fast = np.exp(-t * (half + theta))
        cosh, sinh_by_theta = 0.5 * (slow + fast), 0.5 * (slow - fast) / theta
        cos, sin = np.cos(self.omega * t), np.sin(self.omega * t)
        rho1 = self.alpha[0] * cos + self.alpha[1] * sin
        rho1 = rho1 + self.eta * cosh + (self.lambda_ - self.eta * half) * sinh_by_theta
        rho2 = self.beta[0] * cos + self.beta[1] * sin
        rho2 = rho2 + self.kappa * cosh + (self.delta - self.kappa * half) * sinh_by_theta
        return np.asarray(rho1), np.asarray(rho2)


def closed_form(k: Coefficients, frequency_hz: Values, *, printed: bool = False) -> ClosedForm:
    """Appendix B for coefficients (16)-(17) and a frequency in Hz; `printed` leaves lambda and
    delta as they stand.
    """
    a, b, c, d, e, f = k.a, k.b, k.c, k.d, k.e, k.f
    w = 2.0 * pi * frequency_hz
    psi = w**4 + (a**2 + e**2 + 2 * b * d) * w**2 + (a * e - b * d) ** 2
    eta = (
        (a * c + b * f) * w**2 + a * c * e**2 + d * f * b**2 - a * b * e * f - b * c * d * e
    ) / psi
    kappa = (
        (c * d + e * f) * w**2 + b * c * d**2 + e * f * a**2 - a * b * d * f - a * c * d * e
    ) / psi
    lambda_ = (
        (c * a * e - c * b * d) * w**2
        + c * a * e**3
        - c * b * d * e**2
        - f * a * b * e**2
        - f * b * e * a**2
    )
    delta = (
        (f * a * e - f * b * d) * w**2
        + f * e * a**3
        - f * b * d * a**2
        - c * d * e * a**2
        - c * a * d * e**2
    )
    if not printed:
        lambda_ = lambda_ + b * d * (a * b * f + a * c * e - b * c * d + b * e * f)
        delta = delta + b * d * (a * c * d + a * e * f - b * d * f + c * d * e)
    return ClosedForm(
        coefficients=k,
        omega=w,
        alpha=(-eta, -(c * w**3 + (c * e**2 - a * b * f + b * c * d - b * e * f) * w) / psi),
        beta=(-kappa, -(f * w**3 + (f * a**2 - a * c * d + b * d * f - c * d * e) * w) / psi),
        eta=eta,
        kappa=kappa,
        lambda_=lambda_ / psi,
        delta=delta / psi,
    )
