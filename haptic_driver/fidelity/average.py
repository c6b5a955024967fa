"""A steady window of readings -> friction, its standard error and the load."""

from __future__ import annotations

from math import isfinite, sqrt
from typing import NamedTuple

import numpy as np

from haptic_driver.signals import Array

WINDOW_COLUMNS = (  # a data file's first: what was set in a steady window, and what it gave
    "frequency_hz",
    "voltage_v",
    "normal_force_n",
    "cof",
    "cof_std",
    "speed_m_s",
    "time_s",
    "session",
    "trial",
)
# the autocorrelation is summed over this many correlation times: least error for wobbles as here
WINDOW_FACTOR = 3.0


class Measured(NamedTuple):
    """Coefficient of friction, the standard error (1 sigma) of this mean, mean load, and the middle
    of the window.
    """

    cof: float
    cof_std: float
    normal_force_n: float
    time_s: float

    @property
    def valid(self) -> bool:
        """Whether all are numbers that data may hold."""
        return all(map(isfinite, self)) and self.cof > 0.0 and self.cof_std > 0.0


def average(time_s: Array, lateral_n: Array, normal_n: Array) -> Measured:
    """Ratio of the mean forces of n evenly spaced readings, with the error that their scatter
    implies.
    """
    normal = float(np.mean(normal_n))
    cof = float(np.mean(lateral_n)) / normal
    error = standard_error((lateral_n - cof * normal_n) / normal)
    return Measured(cof, error, normal, float(np.mean(time_s)))


def standard_error(series: Array) -> float:
    """Standard error of the mean of a stationary series of n values that remember one another.

    It is sqrt(C n^-1) with C the autocovariance summed over a window that closes by itself, after
    WINDOW_FACTOR integrated correlation times. It is corrected for the mean having been taken from
    the same series (Wolff, Comput. Phys. Commun. 156 (2004) 143, equations 31, 35 and 49; the
    window of Madras and Sokal, J. Stat. Phys. 50 (1988) 109).
    """
    n = series.size
    deviation = series - np.mean(series)
    covariance = np.correlate(deviation, deviation, "full")[n - 1 :] / np.arange(n, 0, -1)
    if covariance[0] <= 0.0:
        return 0.0
    total = covariance[0]
    for lag in range(1, n // 4):
        total = max(total + 2.0 * covariance[lag], covariance[0] / n)
        if lag >= WINDOW_FACTOR * 0.5 * total / covariance[0]:
            break
    return sqrt(total * (1.0 + (2 * lag + 1) / n) / n)
