"""From electrostatic force to the coefficient of friction that a sensor reads, and back.

`applied_load`: the sensor under the screen reads the applied normal force, mu = mu_off (1 +
F_e/F_n). `total_load`: (31) of AliAbbasi et al. 2022 as printed, mu = mu_off/(1 - F_e/F_n),
diverging as F_e nears F_n.
"""

from __future__ import annotations

import numpy as np

from model.parameters import FrictionLaw
from model.support.arrays import Array, Values
from model.touch import LOAD_REFERENCE_N, Friction


def cof(
    law: FrictionLaw,
    cof_off: Values,
    attraction_n: Values,
    normal_force_n: Values,
    laws: Friction | None = None,
) -> Array:
    """Coefficient of friction under attraction; NaN where `total_load` has diverged (F_e >= F_n).

    `laws` bends the proportionality between friction and load; without it friction is Coulomb's.
    """
    laws = laws or Friction()
    ratio = attraction_n / normal_force_n
    if law == "applied_load":
        rise = 1.0 + ratio
    else:
        with np.errstate(divide="ignore"):
            rise = np.where(ratio < 1.0, 1.0 / (1.0 - ratio), np.nan)
    bend = (rise * normal_force_n / LOAD_REFERENCE_N) ** (laws.load_exponent - 1.0)
    return np.asarray(cof_off * laws.cof_off_factor * rise * bend)


def electrostatic_force_n(
    law: FrictionLaw, cof_off: float, cof_on: Array, normal_force_n: Array
) -> Array:
    """The force that gives the friction `cof_on` by Coulomb's law: the inverse of `cof`."""
    ratio = cof_on / cof_off - 1.0 if law == "applied_load" else 1.0 - cof_off / cof_on
    return np.asarray(ratio * normal_force_n)
