"""The electrical stack between electrode and finger: insulator, air gap, skin, and the leak beside
the gap.

Sections 1-2 of docs/physics.md; equations (1), (8), (10) and (36)-(40) of AliAbbasi et al. 2022,
with complex relative permittivities k = eps' + sigma/(j w eps0) and the conduction counted once.
"""

from __future__ import annotations

from math import pi

import numpy as np

from model.contact.roughness import contact_length_m
from model.electric.dielectrics import EPS0, Dielectric, total_conductivity_s_per_m
from model.parameters import TouchParameters
from model.support.arrays import Array, Values
from model.touch import Branch

DC_FREQUENCY_HZ = 1e-9  # stands for direct current: every layer conducts long before it displaces


def branch(parameters: TouchParameters, dielectric: Dielectric, frequency_hz: Array) -> Branch:
    """The stack at each frequency in Hz (any shape); 0 Hz means direct current."""
    f = np.maximum(np.asarray(frequency_hz, dtype=np.float64), DC_FREQUENCY_HZ)
    jw_eps0 = 2j * pi * f * EPS0
    return Branch(
        omega=2.0 * pi * f,
        k_insulator=parameters.insulator_permittivity
        + parameters.insulator_conductivity_s_per_m / jw_eps0,
        k_skin=dielectric.permittivity(f),
        k_gap=1.0 + parameters.air_conductivity_s_per_m / jw_eps0,
    )


def leak_per_m_pa(parameters: TouchParameters, branch: Branch) -> Values:
    """alpha/(j w eps0) per pascal of total pressure, 1/(m Pa), with the skin's total conductivity
    at this frequency.
    """
    conductivity = total_conductivity_s_per_m(branch.k_skin, branch.omega / (2.0 * pi))
    return leak_conductance_per_pa(parameters, conductivity) / (1j * branch.omega * EPS0)


def leak_conductance_per_pa(
    parameters: TouchParameters, skin_conductivity_s_per_m: Values
) -> Values:
    """alpha of (36) per pascal, S/(m^2 Pa), limited by the skin's conductivity and not by the
    insulator's (37).
    """
    p = parameters
    length_m = contact_length_m(
        p.hurst_exponent, p.roughness_rms_m, p.roll_off_wavenumber_per_m, p.cut_off_wavenumber_per_m
    )
    return p.leak_scale * 2.0 * skin_conductivity_s_per_m / (p.effective_modulus_pa * length_m)
