"""The numbers a touch depends on: frozen records with unit, range, source and uncertainty.

`TouchParameters` is what the physics computes with: plain floats, the unit in the name. Where a fit
runs many parameter sets at once they are arrays that broadcast against the conditions.
"""

from __future__ import annotations

from dataclasses import MISSING, dataclass, field, fields
from typing import Any, Literal

from model.contact.roughness import SelfAffineShape

FrictionLaw = Literal["applied_load", "total_load"]
FRICTION_LAWS: tuple[FrictionLaw, ...] = ("applied_load", "total_load")


def _parameter(unit: str, low: float, high: float, about: str, default: Any = MISSING) -> Any:
    known = None if default is MISSING else default
    return field(
        default=default,
        metadata={"unit": unit, "low": low, "high": high, "about": about, "default": known},
    )


@dataclass(frozen=True)
class TouchParameters:
    """One finger on one screen. The range beside each number is what a file may say."""

    insulator_permittivity: float = _parameter(
        "1", 1.0, 100.0, "eps_1, relative permittivity of the insulator"
    )
    insulator_thickness_m: float = _parameter("m", 1e-8, 1e-3, "d_1, thickness of the insulator")
    insulator_conductivity_s_per_m: float = _parameter(
        "S/m", 0.0, 1e-3, "sigma_1, conductivity of the insulator"
    )
    air_conductivity_s_per_m: float = _parameter(
        "S/m", 0.0, 1e-3, "sigma_g, conductivity of the air gap"
    )
    skin_thickness_m: float = _parameter("m", 1e-6, 1e-2, "d_2, thickness of the stratum corneum")
    screen_modulus_pa: float = _parameter("Pa", 1e3, 1e13, "Y_1, Young's modulus of the screen")
    screen_poisson_ratio: float = _parameter("1", 0.0, 0.5, "nu_1, Poisson's ratio of the screen")
    skin_modulus_pa: float = _parameter(
        "Pa", 1e3, 1e12, "Y_2, Young's modulus of the stratum corneum"
    )
    skin_poisson_ratio: float = _parameter(
        "1", 0.0, 0.5, "nu_2, Poisson's ratio of the stratum corneum"
    )
    roughness_rms_m: float = _parameter(
        "m", 1e-8, 1e-3, "h_rms, rms height of the fingerpad's roughness"
    )
    hurst_exponent: float = _parameter("1", 0.2, 0.98, "H of the fingerpad's roughness")
    roll_off_wavenumber_per_m: float = _parameter(
        "1/m", 1.0, 1e7, "q_0, smallest wavenumber of the roughness"
    )
    cut_off_wavenumber_per_m: float = _parameter(
        "1/m", 1e3, 1e12, "q_1, largest wavenumber of the roughness"
    )
    contact_gamma: float = _parameter("1", 0.1, 1.0, "gamma of (45)")
    contact_area_m2: float = _parameter("m^2", 1e-6, 1e-2, "A_0, apparent area of contact")
    leak_scale: float = _parameter(
        "1", 0.0, 1e6, "factor on the skin-limited contact conductance alpha"
    )
    cof_off: float = _parameter("1", 0.01, 5.0, "mu_off, coefficient of friction without voltage")
    gap_offset_m: float = _parameter(
        "m", 0.0, 1e-4, "what holds the skin off the screen everywhere, e.g. a film", 0.0
    )
    stray_capacitance_f: float = _parameter(
        "F", 0.0, 1e-6, "C_stray, straight from electrode and leads to ground", 0.0
    )
    open_circuit: float = _parameter(
        "1", 0.5, 2.0, "C_stray of an open circuit over that beside a finger", 1.0
    )
    rest_softening: float = _parameter(
        "1", 1e-3, 1.0, "Y_2 of a resting finger over that of a sliding one", 0.1
    )

    @property
    def effective_modulus_pa(self) -> float:
        """Y* of (38)."""
        screen = (1.0 - self.screen_poisson_ratio**2) / self.screen_modulus_pa
        skin = (1.0 - self.skin_poisson_ratio**2) / self.skin_modulus_pa
        return 1.0 / (screen + skin)

    @property
    def pressure_scale_pa(self) -> float:
        """Y* q0 h_rms, the unit of the contact theory's pressures."""
        return self.effective_modulus_pa * self.roll_off_wavenumber_per_m * self.roughness_rms_m

    @property
    def roughness_shape(self) -> SelfAffineShape:
        """What of the roughness is no scale."""
        magnification = self.cut_off_wavenumber_per_m / self.roll_off_wavenumber_per_m
        return SelfAffineShape(self.hurst_exponent, magnification, self.contact_gamma)


SPECIFICATION = {f.name: f.metadata for f in fields(TouchParameters)}


@dataclass(frozen=True)
class Parameter:
    """One number of a model file: `std` is one standard deviation in the same unit, None where
    unknown.
    """

    value: float
    unit: str
    source: str
    std: float | None = None
