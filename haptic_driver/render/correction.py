"""What speed and time do to friction, as a correction to a surface that was solved at one speed and time 0.

cof = time_factor(t) [ off_factor(n, v) cof_off(n) + gain_factor(f, n, v, V) rise(f, n, V) ]: friction without voltage
and the rise through attraction are corrected apart, since effects of speed act on one or the other.
"""

from __future__ import annotations

from math import hypot
from typing import NamedTuple

import numpy as np

from haptic_driver.render import kernels
from haptic_driver.render.kernels import Array
from haptic_driver.signals import FingerState


class Correction(NamedTuple):
    """Nodes of log frequency [f], log normal force [n], log speed [s], voltage [v] and time [t], and factors on them.

    `off_factor` [n, s], `gain_factor` [f, n, s, v], `time_factor` [t]; outside the nodes the nearest holds.
    """

    log_frequency: Array
    log_normal_force: Array
    log_speed: Array
    voltage_v: Array
    time_s: Array
    off_factor: Array
    gain_factor: Array
    time_factor: Array

    def at(self, frequency_hz: float, voltage_v: float, finger: FingerState) -> tuple[float, float]:
        """Factors on friction without voltage and on the rise through attraction, for this finger and drive."""
        speed_m_s = hypot(finger.velocity_x_m_s, finger.velocity_y_m_s)
        found: tuple[float, float] = kernels.correction_factors(
            *self, frequency_hz, voltage_v, finger.normal_force_n, speed_m_s, finger.time_s
        )
        return found


_ENDS = np.array([0.0, 1.0])
NO_CORRECTION = Correction(
    _ENDS, _ENDS, _ENDS, _ENDS, _ENDS, np.ones((2, 2)), np.ones((2, 2, 2, 2)), np.ones(2)
)  # fmt: skip
"""Factors of 1, for kernels that take one in any case."""
