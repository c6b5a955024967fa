"""From electrostatic force to the coefficient of friction that a sensor reads, and back.

`applied_load`: the sensor under the screen reads the applied normal force, mu = mu_off (1 + F_e/F_n).
`total_load`: (31) of AliAbbasi et al. 2022 as printed, mu = mu_off/(1 - F_e/F_n), diverging as F_e nears F_n.
"""

from __future__ import annotations

import numpy as np

from model.dielectrics import Array
from model.parameters import FrictionLaw


def cof(law: FrictionLaw, cof_off: float, electrostatic_force_n: Array, normal_force_n: Array) -> Array:
    """Coefficient of friction under attraction; NaN where `total_load` has diverged (F_e >= F_n)."""
    ratio = electrostatic_force_n / normal_force_n
    if law == "applied_load":
        return np.asarray(cof_off * (1.0 + ratio))
    with np.errstate(divide="ignore"):
        return np.where(ratio < 1.0, cof_off / (1.0 - ratio), np.nan)


def electrostatic_force_n(law: FrictionLaw, cof_off: float, cof_on: Array, normal_force_n: Array) -> Array:
    """The force that gives the friction `cof_on`: the inverse of `cof`."""
    ratio = cof_on / cof_off - 1.0 if law == "applied_load" else 1.0 - cof_off / cof_on
    return np.asarray(ratio * normal_force_n)
