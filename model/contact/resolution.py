"""How finely gaps are resolved: the axes of the gap table, and the rules of the quadrature behind
it.

All of it is part of the key under which a table is kept on disk.
"""

from __future__ import annotations

import math

# of the cached file and of the quadrature behind it: raise it when either changes otherwise
FORMAT = 2
LOG_P_AXIS = (
    math.log(1e-6),
    math.log(10.0),
    85,
)  # first, last and number of nodes; pressures in Y* q0 h_rms
LOG_Z_AXIS = (math.log(1e-7), math.log(1e3), 121)  # lengths, in h_rms
ANGLE_AXIS = (0.0, math.pi / 2.0, 15)
LOG_U_AXIS = (math.log(1e-13), math.log(60.0), 0.1)  # first, end and step; gaps, in h_rms

ZETA_MINUS_ONE_LOW = 1e-14  # lowest magnification
# of the magnification's logistic variable: zeta1 - zeta is e^-24 of zeta1 there
LOGISTIC_END = 24.0
MAGNIFICATION_STEP = 0.2  # of that variable for the table; against 0.05: 3e-8 in every integral
X_NEGLIGIBLE = 6.5  # exp(-x^2) < 1e-18 beyond
S_NODES = 64  # of the integral over scales
