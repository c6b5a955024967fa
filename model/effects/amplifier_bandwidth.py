"""The amplifier rolls off: less voltage at the electrode at high frequency."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from model.effects.base import Effect, log_parameter
from model.support.arrays import Array, Values
from model.touch import Drive

# Nodes u = ln(f'/f) and weights of the integral over ln coth(u/2), a trapezoid rule in ln u.
_LOG_NODES = np.arange(-13.0, 3.2, 0.15)
_NODES = np.exp(_LOG_NODES)
_WEIGHTS = np.diff(_LOG_NODES[:2]) * _NODES * -np.log(np.tanh(0.5 * _NODES))


@dataclass(frozen=True)
class AmplifierBandwidth(Effect):
    """V -> V/sqrt(1 + (f/f_c)^(2n)), with the minimum phase that belongs to it."""

    name = "amplifier_bandwidth"
    stage = "drive"
    physics = "the amplifier's bandwidth limits the voltage at high frequency"
    signature = (
        "force falls at high frequency, by the same share at every voltage and load; so does the"
        " electrode's voltage, which lags, and the current with it: their ratio stays"
    )
    check = (
        "measure the electrode at 1 kHz and 100 kHz with a high-impedance probe; swap the amplifier"
    )
    removed_by = ("other_amplifier",)

    # Two standard deviations: from 500 Hz, of piezo amplifiers under load, to 80 MHz, whose phase
    # spectra still see.
    cutoff_hz: float = log_parameter("Hz", 2e5, 20.0, (1.0, 1e9), off=float("inf"))
    order: float = log_parameter("1", 1.3, 1.6, (0.5, 6.0), off=1.0)

    def drive(self, drive: Drive) -> Drive:
        roll_off = (drive.frequency_hz / self.cutoff_hz) ** (2.0 * self.order)
        lag_rad = minimum_phase_lag_rad(drive.frequency_hz / self.cutoff_hz, self.order)
        return replace(
            drive,
            voltage_v=drive.voltage_v / np.sqrt(1.0 + roll_off),
            voltage_phase_rad=drive.voltage_phase_rad - lag_rad,
        )


def minimum_phase_lag_rad(x: Values, order: Values) -> Array:
    """Lag in rad of the minimum-phase filter of gain 1/sqrt(1 + x^(2 order)) at x = f/f_c; any
    shapes, any real order.

    Bode's relation is (1/pi) int -d ln|g|/du ln coth|u/2| du over u = ln(f'/f). The slope in it is
    order times the logistic function of 2 order (ln x + u). The result is Butterworth's phase
    exactly where the order is whole.
    """
    with np.errstate(divide="ignore"):
        at = 2.0 * np.log(x)
    at, order = np.broadcast_arrays(
        np.asarray(at, float)[..., None], np.asarray(order, float)[..., None]
    )
    slopes = _logistic(order * (at + 2.0 * _NODES)) + _logistic(order * (at - 2.0 * _NODES))
    return np.asarray(order[..., 0] / np.pi * (slopes @ _WEIGHTS))


def _logistic(x: Array) -> Array:
    return np.asarray(0.5 + 0.5 * np.tanh(0.5 * x))
