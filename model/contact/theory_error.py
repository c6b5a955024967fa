"""How far Persson's contact theory is from a boundary-element solution of the same contact: one
table, one function.

`LOG_STD` is |log(solver/theory)| of K = integral of P/(u + h)^2 over the gaps, to which the
electrostatic pressure is proportional. The numbers come from docs/validation.md: random self-affine
surfaces (H 0.71, h_rms 20 um, q0 1e3 1/m, q1/q0 = 32, Y* 13.33 MPa; tamaas, Polonsky-Keer). Each is
the largest of three. These are the rms at the finest grid, the same extrapolated to points without
size, and an earlier comparison of four surfaces. None is below 0.05, the scatter between surfaces.
A fingerpad is rough over more scales than any solver resolves (q1/q0 = 1e7 in Table I). So for a
finger this is a judged error, not a measured one.
"""

from __future__ import annotations

import numpy as np

from model.support.arrays import Array, Values
from model.support.interpolation import linear_weights

PRESSURE_PA = (5e3, 20e3, 100e3)
GAP_LENGTH_M = (0.3e-6, 1e-6, 5e-6)
LOG_STD = (  # [pressure, length]
    (0.30, 0.29, 0.12),
    (0.15, 0.16, 0.08),
    (0.23, 0.12, 0.05),
)
PRESSURE_SCALE_PA = 13.33e6 * 1e3 * 20e-6  # Y* q0 h_rms of the compared contact
LENGTH_SCALE_M = 20e-6  # h_rms of the compared contact


def theory_log_std(
    pressure_pa: Values,
    gap_length_m: Values,
    *,
    pressure_scale_pa: Values = PRESSURE_SCALE_PA,
    length_scale_m: Values = LENGTH_SCALE_M,
) -> Array:
    """One standard deviation of log(electrostatic pressure) that the contact theory leaves;
    everything broadcasts.

    `pressure_pa` is the total pressure on the contact, `gap_length_m` the electrical length added
    to each gap (the modulus of z, or of h). The scales are Y* q0 h_rms and h_rms of the finger
    in question. The theory depends on p/(Y* q0 h_rms) and z/h_rms alone. Linear in the
    logarithms; outside the compared range the nearest compared value holds.
    """
    p = np.asarray(pressure_pa, dtype=np.float64) * PRESSURE_SCALE_PA / pressure_scale_pa
    length = np.asarray(gap_length_m, dtype=np.float64) * LENGTH_SCALE_M / length_scale_m
    by_pressure = linear_weights(np.log(PRESSURE_PA), np.log(p))
    by_length = linear_weights(np.log(GAP_LENGTH_M), np.log(length))
    return np.asarray(np.einsum("...p,...l,pl", by_pressure, by_length, np.array(LOG_STD)))
