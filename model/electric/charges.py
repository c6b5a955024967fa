"""Charges at the interfaces insulator-air and air-skin over time.

Equations (4)-(17) of AliAbbasi et al. 2022 with (15) corrected (docs/errata.md) and absolute
permittivities. A transient needs constants: permittivity and conductivity of the skin are those at
one stated frequency. The contact leak, where it is used, conducts beside the air of each gap as in
`layers`. Without it (the default) these are the paper's equations.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from model.electric.dielectrics import EPS0, Dielectric, total_conductivity_s_per_m
from model.parameters import TouchParameters
from model.support.arrays import Values
from model.support.errors import ModelError


@dataclass(frozen=True)
class Layers:
    """Constants of insulator (1), air gap (g) and skin (2): SI units, permittivities absolute.

    `contact_conductance_s_per_m2` is alpha, conduction beside the air of every gap.
    """

    insulator_thickness_m: Values
    insulator_permittivity_f_per_m: Values
    insulator_conductivity_s_per_m: Values
    air_permittivity_f_per_m: Values
    air_conductivity_s_per_m: Values
    skin_thickness_m: Values
    skin_permittivity_f_per_m: Values
    skin_conductivity_s_per_m: Values
    contact_conductance_s_per_m2: Values = 0.0

    @property
    def relative(self) -> Layers:
        """With relative permittivities, as (4)-(26) are printed where the laws have absolute ones
        (slip 6).
        """
        names = [name for name in vars(self) if "permittivity" in name]
        return replace(self, **{name: getattr(self, name) / EPS0 for name in names})

    def elastances(self, gap_m: Values) -> tuple[Values, Values, Values]:
        """Thickness over permittivity of insulator, gap and skin, m^2/F."""
        return (
            self.insulator_thickness_m / self.insulator_permittivity_f_per_m,
            gap_m / self.air_permittivity_f_per_m,
            self.skin_thickness_m / self.skin_permittivity_f_per_m,
        )

    def relaxation_rates_per_s(self, gap_m: Values) -> tuple[Values, Values, Values]:
        """Conductivity over permittivity of insulator, gap and skin, 1/s."""
        air = self.air_conductivity_s_per_m + self.contact_conductance_s_per_m2 * gap_m
        return (
            self.insulator_conductivity_s_per_m / self.insulator_permittivity_f_per_m,
            air / self.air_permittivity_f_per_m,
            self.skin_conductivity_s_per_m / self.skin_permittivity_f_per_m,
        )


@dataclass(frozen=True)
class Coefficients:
    """a to f of (16)-(17): -d rho1/dt = a rho1 + b rho2 + c V, -d rho2/dt = d rho1 + e rho2 + f V.

    a, b, d, e in 1/s; c, f in S/m^2 (per volt: A/m^2).
    """

    a: Values
    b: Values
    c: Values
    d: Values
    e: Values
    f: Values

    def response(self, s_per_s: Values) -> tuple[Values, Values]:
        """rho1 and rho2 per volt, C/(m^2 V), at the complex frequency s: (18)-(19); s = j w gives
        the AC phasors.
        """
        determinant = (s_per_s + self.e) * (s_per_s + self.a) - self.d * self.b
        rho1 = (-self.c * (s_per_s + self.e) + self.f * self.b) / determinant
        rho2 = (-self.f * (s_per_s + self.a) + self.c * self.d) / determinant
        return rho1, rho2


def constant_layers(
    parameters: TouchParameters, dielectric: Dielectric, dielectric_at_hz: Values
) -> Layers:
    """The layers with the skin's permittivity and total conductivity at `dielectric_at_hz`,
    whatever is driven.
    """
    p, at = parameters, np.asarray(dielectric_at_hz, dtype=np.float64)
    if not (np.isfinite(at) & (at > 0.0)).all():
        raise ModelError(
            f"dielectric_at_hz = {dielectric_at_hz:g} is no frequency",
            "Give a number above 0 in Hz",
        )
    k_skin = dielectric.permittivity(at)
    return Layers(
        insulator_thickness_m=p.insulator_thickness_m,
        insulator_permittivity_f_per_m=EPS0 * p.insulator_permittivity,
        insulator_conductivity_s_per_m=p.insulator_conductivity_s_per_m,
        air_permittivity_f_per_m=EPS0,
        air_conductivity_s_per_m=p.air_conductivity_s_per_m,
        skin_thickness_m=p.skin_thickness_m,
        skin_permittivity_f_per_m=EPS0 * k_skin.real,
        skin_conductivity_s_per_m=total_conductivity_s_per_m(k_skin, at),
    )


def coefficients(layers: Layers, gap_m: Values) -> Coefficients:
    """(14)-(15), the latter corrected, for gaps of any shape.

    With elastances L = d/eps, rates r = sigma/eps and S their sum, D1/eps1 = Dg/eps_g = D2/eps2 =
    S.
    """
    l1, lg, l2 = layers.elastances(gap_m)
    r1, rg, r2 = layers.relaxation_rates_per_s(gap_m)
    whole = l1 + lg + l2
    return Coefficients(
        a=(r1 * (lg + l2) + rg * l1) / whole,
        b=l2 * (r1 - rg) / whole,
        c=(rg - r1) / whole,
        d=l1 * (r2 - rg) / whole,
        e=(r2 * (l1 + lg) + rg * l2) / whole,
        f=(r2 - rg) / whole,
    )
