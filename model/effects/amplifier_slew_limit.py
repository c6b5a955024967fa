"""The amplifier's slew rate turns a fast large sine into a smaller triangle."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from model.effects.base import Effect, log_parameter
from model.touch import Drive


@dataclass(frozen=True)
class AmplifierSlewLimit(Effect):
    """2 pi f V > SR: triangle of peak SR/(4f), whose fundamental is 8/pi^2 of it; never more than the sine itself."""

    name = "amplifier_slew_limit"
    stage = "drive"
    physics = "the amplifier cannot slew as fast as the sine asks"
    signature = "force falls where frequency times voltage is large, and nowhere else"
    check = "watch the electrode on an oscilloscope: the sine turns into a triangle at high f and V"

    slew_rate_v_per_s: float = log_parameter("V/s", 1e7, 8.0, (1e2, 1e12), off=float("inf"))

    def drive(self, drive: Drive) -> Drive:
        """See `Effect`."""
        wanted = 2.0 * np.pi * drive.frequency_hz * drive.voltage_v
        fundamental = 8.0 / np.pi**2 * self.slew_rate_v_per_s / (4.0 * np.maximum(drive.frequency_hz, 1e-9))
        limited = np.minimum(fundamental, drive.voltage_v)
        return replace(drive, voltage_v=np.where(wanted > self.slew_rate_v_per_s, limited, drive.voltage_v))
