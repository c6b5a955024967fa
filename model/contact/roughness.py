"""Self-affine roughness of the fingerpad, in closed form.

Spectrum (41) of AliAbbasi et al. 2022 from q0 to q1 without a plateau. Everything dimensionless is
in units of h_rms (heights), 1/q0 (lateral lengths) and Y* q0 h_rms (pressures). Two fingers with
the same Hurst exponent, q1/q0 and gamma differ by these scales alone.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import exp, lgamma, pi, sqrt

import numpy as np

from model.support.arrays import Array, Values


@dataclass(frozen=True)
class SelfAffineShape:
    """What of a rough surface cannot be scaled away.

    `hurst`: Hurst exponent H (0..1); `zeta1`: q1/q0, the largest magnification; `gamma`: the
    constant of (45).
    """

    hurst: float
    zeta1: float
    gamma: float

    @property
    def full_contact(self) -> float:
        """The pressure at which the contact is nearly complete: A_real/A0 of (42) is the erf of
        p_hat over it.
        """
        return sqrt(self.hurst * float(self.moment3(np.asarray(self.zeta1))))

    def moment3(self, zeta: Array) -> Array:
        """Integral of x^(1-2H) from 1 to zeta: int q^3 C dq of (43) in units of (H/pi) (h_rms
        q0)^2.
        """
        k = 2.0 - 2.0 * self.hurst
        return np.asarray(np.expm1(k * np.log(zeta)) / k)


def contact_length_m(hurst: float, h_rms_m: Values, q0_per_m: float, q1_per_m: float) -> Values:
    """Characteristic length L0 of (39) in m, with r(H) of (40) in closed form."""
    scale = sqrt(2.0 * (1.0 - hurst) / (pi * hurst)) * (
        r_of_hurst(hurst) - (q0_per_m / q1_per_m) ** hurst
    )
    return scale * h_rms_m


def r_of_hurst(hurst: float) -> float:
    """r(H) of (40) with exponent -1/[2(1-H)] (the literal reading diverges)."""
    s = hurst / (2.0 * (1.0 - hurst))
    return s * sqrt(pi) * exp(lgamma(s) - lgamma(s + 0.5))
