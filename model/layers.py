"""The electrical stack between electrode and finger: insulator, air gap, skin, and the leak beside the gap.

Sections 1-2 of docs/physics.md; equations (1), (8), (10) and (36)-(40) of AliAbbasi et al. 2022, with complex relative
permittivities k = eps' + sigma/(j w eps0) and the conduction counted once.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import pi

import numpy as np

from model.dielectrics import EPS0, Array, ComplexArray, Dielectric, total_conductivity_s_per_m
from model.parameters import TouchParameters
from model.roughness import contact_length_m

DC_FREQUENCY_HZ = 1e-9  # stands for direct current: every layer conducts long before it displaces


@dataclass(frozen=True)
class Stack:
    """What the gap's field depends on, per frequency: E(u) = V/(a u + k_gap h), a = 1 + leak p h.

    `omega` [n] in rad/s; `h_m` [n]: d1/k1 + d2/k2, complex, m; `k_gap` [n]: permittivity of air;
    `leak_per_m_pa` [n]: alpha/(j w eps0) per pascal of total pressure, 1/(m Pa).
    """

    omega: Array
    h_m: ComplexArray
    k_gap: ComplexArray
    leak_per_m_pa: ComplexArray

    def reshaped(self, shape: tuple[int, ...]) -> Stack:
        """The same stack with its frequencies along other axes, to broadcast against grids."""
        return Stack(
            self.omega.reshape(shape),
            self.h_m.reshape(shape),
            self.k_gap.reshape(shape),
            self.leak_per_m_pa.reshape(shape),
        )


def stack(parameters: TouchParameters, dielectric: Dielectric, frequency_hz: Array) -> Stack:
    """The stack at each frequency [n] in Hz; 0 Hz means direct current."""
    p = parameters
    f = np.maximum(np.asarray(frequency_hz, dtype=np.float64), DC_FREQUENCY_HZ)
    omega = 2.0 * pi * f
    jw_eps0 = 1j * omega * EPS0
    k_skin = dielectric.permittivity(f)
    k_insulator = p.insulator_permittivity + p.insulator_conductivity_s_per_m / jw_eps0
    alpha_per_pa = leak_conductance_per_pa(p, total_conductivity_s_per_m(k_skin, f))
    return Stack(
        omega=omega,
        h_m=p.insulator_thickness_m / k_insulator + p.skin_thickness_m / k_skin,
        k_gap=np.asarray(1.0 + p.air_conductivity_s_per_m / jw_eps0, dtype=np.complex128),
        leak_per_m_pa=alpha_per_pa / jw_eps0,
    )


def leak_conductance_per_pa(parameters: TouchParameters, skin_conductivity_s_per_m: Array) -> Array:
    """alpha of (36) per pascal, S/(m^2 Pa), limited by the skin's conductivity and not by the insulator's (37)."""
    p = parameters
    length_m = contact_length_m(
        p.hurst_exponent, p.roughness_rms_m, p.roll_off_wavenumber_per_m, p.cut_off_wavenumber_per_m
    )
    return np.asarray(p.leak_scale * 2.0 * skin_conductivity_s_per_m / (p.effective_modulus_pa * length_m))
