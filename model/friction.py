"""From electrostatic force to the coefficient of friction that a sensor reads, and back.

`applied_load`: the sensor under the screen reads the applied normal force, mu = mu_off (1 + F_e/F_n).
`total_load`: (31) of AliAbbasi et al. 2022 as printed, mu = mu_off/(1 - F_e/F_n), diverging as F_e nears F_n.
"""

from __future__ import annotations

import numpy as np

from model.dielectrics import Array
from model.parameters import FrictionLaw
from model.touch import Friction, Values

LOAD_REFERENCE_N = 0.5  # the load at which a load exponent leaves friction as it is


def cof(
    law: FrictionLaw, cof_off: Values, attraction_n: Array, normal_force_n: Array, laws: Friction | None = None
) -> Array:
    """Coefficient of friction under attraction; NaN where `total_load` has diverged (F_e >= F_n).

    `laws` bends the proportionality between friction and load; without it friction is Coulomb's.
    """
    laws = laws or Friction()
    rise = np.asarray(attraction_n / normal_force_n)  # its own array: whole surfaces are worked on in place
    if law == "applied_load":
        rise += 1.0
    else:
        with np.errstate(divide="ignore"):
            rise = np.where(rise < 1.0, 1.0 / (1.0 - rise), np.nan)
    bend = np.asarray(laws.load_exponent - 1.0)
    if bend.any():
        rise = rise * (rise * normal_force_n / LOAD_REFERENCE_N) ** bend
    factor = np.asarray(cof_off * laws.cof_off_factor)
    if np.broadcast_shapes(rise.shape, factor.shape) != rise.shape:
        return np.asarray(rise * factor)
    rise *= factor
    return rise


def electrostatic_force_n(law: FrictionLaw, cof_off: float, cof_on: Array, normal_force_n: Array) -> Array:
    """The force that gives the friction `cof_on` by Coulomb's law: the inverse of `cof`."""
    ratio = cof_on / cof_off - 1.0 if law == "applied_load" else 1.0 - cof_off / cof_on
    return np.asarray(ratio * normal_force_n)
