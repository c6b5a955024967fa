"""The amplifier rolls off: less voltage at the electrode at high frequency."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from model.effects.base import Effect, log_parameter
from model.touch import Drive


@dataclass(frozen=True)
class AmplifierBandwidth(Effect):
    """V -> V/sqrt(1 + (f/f_c)^(2n))."""

    name = "amplifier_bandwidth"
    stage = "drive"
    physics = "the amplifier's bandwidth limits the voltage at high frequency"
    signature = "force falls at high frequency, by the same share at every voltage and load"
    check = "measure the electrode at 1 kHz and 100 kHz with a high-impedance probe; swap the amplifier"

    cutoff_hz: float = log_parameter("Hz", 2e4, 8.0, (1.0, 1e9), off=float("inf"))
    order: float = log_parameter("1", 1.3, 1.6, (0.5, 6.0), off=1.0)

    def drive(self, drive: Drive) -> Drive:
        """See `Effect`."""
        roll_off = (drive.frequency_hz / self.cutoff_hz) ** (2.0 * self.order)
        return replace(drive, voltage_v=drive.voltage_v / np.sqrt(1.0 + roll_off))
