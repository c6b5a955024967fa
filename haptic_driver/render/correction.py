"""What speed and time do to friction, as a correction to a surface that was solved at one speed and
time 0.

cof = time_factor(t) [ off_factor(n, v) cof_off(n) + gain_factor(f, n, v, V) rise(f, n, V) ].
Friction without voltage and the rise through attraction are corrected apart, since effects of speed
act on one or the other. Time counts from the touch.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from haptic_driver.render.compiled import kernel
from haptic_driver.render.surface import between
from haptic_driver.signals import Array, FingerState


class Correction(NamedTuple):
    """Nodes of log frequency [f], log normal force [n], log speed [s], voltage [v] and time [t],
    and factors on them.

    `off_factor` [n, s], `gain_factor` [f, n, s, v], `time_factor` [t]; outside the nodes the
    nearest holds.
    """

    log_frequency: Array
    log_normal_force: Array
    log_speed: Array
    voltage_v: Array
    time_s: Array
    off_factor: Array
    gain_factor: Array
    time_factor: Array


_ENDS = np.array([0.0, 1.0])
NO_CORRECTION = Correction(
    _ENDS, _ENDS, _ENDS, _ENDS, _ENDS, np.ones((2, 2)), np.ones((2, 2, 2, 2)), np.ones(2)
)
"""Factors of 1."""


class Factors(NamedTuple):
    """On friction without voltage, and on the rise through attraction."""

    off: float
    rise: float


@kernel
def factors_at(
    correction: Correction, frequency_hz: float, voltage_v: float, finger: FingerState
) -> Factors:
    """The factors for this drive and this finger."""
    speed_m_s = max(np.hypot(finger.velocity_x_m_s, finger.velocity_y_m_s), 1e-9)
    f, f_share = among(correction.log_frequency, np.log(frequency_hz))
    n, n_share = among(correction.log_normal_force, np.log(finger.normal_force_n))
    s, s_share = among(correction.log_speed, np.log(speed_m_s))
    v, v_share = among(correction.voltage_v, voltage_v)
    t, t_share = among(correction.time_s, finger.contact_s)
    off, rise = 0.0, 0.0
    for i in range(2):
        for j in range(2):
            share = (n_share if i else 1.0 - n_share) * (s_share if j else 1.0 - s_share)
            off += share * correction.off_factor[n + i, s + j]
            for k in range(2):
                for m in range(2):
                    part = (
                        share
                        * (f_share if k else 1.0 - f_share)
                        * (v_share if m else 1.0 - v_share)
                    )
                    rise += part * correction.gain_factor[f + k, n + i, s + j, v + m]
    of_time = between(correction.time_factor[t], correction.time_factor[t + 1], t_share)
    return Factors(of_time * off, of_time * rise)


@kernel
def among(nodes: Array, x: float) -> tuple[int, float]:
    """Cell of `x` among rising nodes and the share of the way through it; clamped."""
    cell = min(max(int(np.searchsorted(nodes, x)) - 1, 0), nodes.size - 2)
    return cell, min(max((x - nodes[cell]) / (nodes[cell + 1] - nodes[cell]), 0.0), 1.0)
