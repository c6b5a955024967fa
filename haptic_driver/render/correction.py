"""What speed and time do to friction, as a correction to a surface that was solved at one speed and time 0.

cof = time_factor(t) [ off_factor(n, v) cof_off(n) + gain_factor(f, n, v, V) rise(f, n, V) ]: friction without voltage
and the rise through attraction are corrected apart, since effects of speed act on one or the other.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from haptic_driver.signals import FingerState

Array = NDArray[np.float64]


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
        speed_m_s = float(np.hypot(finger.velocity_x_m_s, finger.velocity_y_m_s))
        n = _locate(self.log_normal_force, np.log(finger.normal_force_n))
        s = _locate(self.log_speed, np.log(max(speed_m_s, 1e-9)))
        f = _locate(self.log_frequency, np.log(frequency_hz))
        v = _locate(self.voltage_v, voltage_v)
        of_time = float(np.interp(finger.time_s, self.time_s, self.time_factor))
        return of_time * _interpolated(self.off_factor, (n, s)), of_time * _interpolated(self.gain_factor, (f, n, s, v))


def _locate(nodes: Array, x: float) -> tuple[int, float]:
    """Cell and fraction of `x` among rising nodes, clamped."""
    cell = int(np.clip(np.searchsorted(nodes, x) - 1, 0, nodes.size - 2))
    return cell, float(np.clip((x - nodes[cell]) / (nodes[cell + 1] - nodes[cell]), 0.0, 1.0))


def _interpolated(values: Array, cells: tuple[tuple[int, float], ...]) -> float:
    """Multilinear in as many axes as `values` has."""
    for cell, fraction in cells:
        values = (1.0 - fraction) * values[cell] + fraction * values[cell + 1]
    return float(values)
