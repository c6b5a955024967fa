"""The amplifier's slew rate turns a fast large sine into a smaller triangle."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from model.effects.base import Effect, log_parameter
from model.support.arrays import Array, ComplexArray
from model.touch import Drive

ALL_THE_TIME = (1.0 + 0.25 * np.pi**2) ** -0.5  # SR/(2 pi f V) below which the output is a triangle
HALVINGS = 60  # of an angle; leave less than a double resolves
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(24)


def _partly_limited(ratio: Array) -> ComplexArray:
    """Fundamental of the output, as a share of the sine, where the amplifier slews for a part of
    the period.

    From the angle where sin t rises faster than `ratio` [n] t, the output lags on a line until it
    meets the sine again. That happens twice in a period.
    """
    start = -np.arccos(ratio)
    low, high = -start, np.full(ratio.shape, np.pi)
    for _ in range(HALVINGS):
        end = 0.5 * (low + high)
        below = np.sin(start) + ratio * (end - start) < np.sin(end)
        low, high = np.where(below, end, low), np.where(below, high, end)
    angle = start[:, None] + 0.5 * (end - start)[:, None] * (1.0 + _NODES)
    lack = np.sin(start)[:, None] + ratio[:, None] * (angle - start[:, None]) - np.sin(angle)
    return np.asarray(1.0 + 1j / np.pi * (end - start) * ((lack * np.exp(-1j * angle)) @ _WEIGHTS))


_RATIOS = np.linspace(ALL_THE_TIME, 1.0, 400)  # interpolation between them is off by 2e-6
_SHARES = _partly_limited(_RATIOS)


@dataclass(frozen=True)
class AmplifierSlewLimit(Effect):
    """2 pi f V > SR: triangle of peak SR/(4f), whose fundamental is 8/pi^2 of it.

    The triangle turns where the falling sine crosses its peak, so that it lags by arccos(SR/(4 f
    V)). That holds where the amplifier slews all the time, SR/(2 pi f V) below 0.54. From there to
    1 it slews for a part of the period, and follows the sine for the rest.

    An input stage saturates softly. So V/(1 + (V/V_t)^p)^(1/p) takes the place of min(V, V_t), with
    V_t the triangle's fundamental and p the `sharpness`. The missing part, which drives the stage,
    leads by a quarter period.
    """

    name = "amplifier_slew_limit"
    stage = "drive"
    physics = "the amplifier cannot slew as fast as the sine asks"
    signature = (
        "force falls where frequency times voltage is large, and nowhere else; there the"
        " electrode's voltage falls and lags, the current with it, and both have a third harmonic"
        " of up to a ninth"
    )
    check = "watch the electrode on an oscilloscope: the sine turns into a triangle at high f and V"
    removed_by = ("other_amplifier",)
    # An amplitude is clipped before or after it changes.
    order_counts_with = ("amplifier_bandwidth", "drive_gain_error")

    slew_rate_v_per_s: float = log_parameter("V/s", 1e7, 8.0, (1e2, 1e12), off=float("inf"))
    sharpness: float = log_parameter(
        "1", 10.0, 2.5, (1.0, 1e6), off=float("inf"), usual=float("inf")
    )

    def drive(self, drive: Drive) -> Drive:
        wanted = 2.0 * np.pi * drive.frequency_hz * drive.voltage_v
        slewing = wanted > self.slew_rate_v_per_s
        ratio = np.divide(
            self.slew_rate_v_per_s, wanted, out=np.ones(np.shape(slewing)), where=slewing
        )
        always = np.minimum(ratio, ALL_THE_TIME)
        left = np.where(
            ratio < ALL_THE_TIME, 4.0 / np.pi * always, np.interp(ratio, _RATIOS, np.abs(_SHARES))
        )
        lag_rad = np.where(
            ratio < ALL_THE_TIME,
            np.arccos(0.5 * np.pi * always),
            -np.interp(ratio, _RATIOS, np.angle(_SHARES)),
        )
        softly, more_lag_rad = self._softly(0.25 * np.pi * wanted / self.slew_rate_v_per_s)
        return replace(
            drive,
            voltage_v=softly * np.where(slewing, left * drive.voltage_v, drive.voltage_v),
            voltage_phase_rad=drive.voltage_phase_rad - lag_rad - more_lag_rad,
        )

    def _softly(self, over: Array) -> tuple[Array, Array]:
        """What is left of the hard limit's amplitude at V/V_t `over`, and how much more it lags."""
        hard = 1.0 / np.maximum(over, 1.0)
        left = (1.0 + np.minimum(over, 1.0 / np.maximum(over, 1e-300)) ** self.sharpness) ** (
            -1.0 / self.sharpness
        )
        return left, np.arccos(np.minimum(hard * left, 1.0)) - np.arccos(hard)
