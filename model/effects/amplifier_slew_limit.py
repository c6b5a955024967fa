"""The amplifier's slew rate turns a fast large sine into a smaller triangle."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from model.effects.base import Effect, log_parameter
from model.touch import Drive

ALL_THE_TIME = (1.0 + 0.25 * np.pi**2) ** -0.5  # SR/(2 pi f V) below which the output is a triangle
LAG_OF_TRIANGLE_RAD = np.arccos(0.5 * np.pi * ALL_THE_TIME)


@dataclass(frozen=True)
class AmplifierSlewLimit(Effect):
    """2 pi f V > SR: triangle of peak SR/(4f), whose fundamental is 8/pi^2 of it; never more than the sine itself.

    The triangle turns where the falling sine crosses its peak, so that it lags by arccos(SR/(4 f V)). That holds where
    the amplifier slews all the time, SR/(2 pi f V) below 0.54; from there to 1 it slews for a part of the period, and
    the lag falls to 0 by a power of 2.1: within 0.012 rad of the exact solution.
    """

    name = "amplifier_slew_limit"
    stage = "drive"
    physics = "the amplifier cannot slew as fast as the sine asks"
    signature = (
        "force falls where frequency times voltage is large, and nowhere else; there the electrode's voltage falls and "
        "lags, the current with it, and both have a third harmonic of up to a ninth"
    )
    check = "watch the electrode on an oscilloscope: the sine turns into a triangle at high f and V"

    slew_rate_v_per_s: float = log_parameter("V/s", 1e7, 8.0, (1e2, 1e12), off=float("inf"))

    def drive(self, drive: Drive) -> Drive:
        """See `Effect`."""
        wanted = 2.0 * np.pi * drive.frequency_hz * drive.voltage_v
        fundamental = 8.0 / np.pi**2 * self.slew_rate_v_per_s / (4.0 * np.maximum(drive.frequency_hz, 1e-9))
        limited = np.minimum(fundamental, drive.voltage_v)
        slewing = wanted > self.slew_rate_v_per_s
        ratio = np.divide(self.slew_rate_v_per_s, wanted, out=np.ones(np.shape(slewing)), where=slewing)
        partly = LAG_OF_TRIANGLE_RAD * ((1.0 - ratio) / (1.0 - ALL_THE_TIME)) ** 2.1
        lag_rad = np.where(ratio < ALL_THE_TIME, np.arccos(0.5 * np.pi * np.minimum(ratio, ALL_THE_TIME)), partly)
        return replace(
            drive,
            voltage_v=np.where(slewing, limited, drive.voltage_v),
            voltage_phase_rad=drive.voltage_phase_rad - lag_rad,
        )
