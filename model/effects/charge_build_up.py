"""Charge reaches the insulator's surface under slow voltage and screens the field."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from model.effects.base import Effect, linear_parameter, log_parameter
from model.support.arrays import Values
from model.touch import Drive


@dataclass(frozen=True)
class ChargeBuildUp(Effect):
    """Mean square V^2/2 -> V^2/2 (1 - s g(f) (1 - exp(-t/T))), g = 1/(1 + (f/f_b)^2).

    `time_s` counts from when the voltage came on. Where it is a session's clock, charge has long
    built up, and the data determine only s g(f).
    """

    name = "charge_build_up"
    stage = "pressure"
    physics = "charge reaches the insulator's surface and screens the field"
    source = (
        "Nakamura and Yamamoto, reference [18] of the paper: less force under direct voltage; a"
        " film on brass at 300 V loses half of it in 2 to 3 s, at 1 kHz nothing; ranges unverified"
    )
    signature = (
        "attraction under direct or slow voltage falls within seconds, at high frequency it stays;"
        " the current follows the pressure only"
    )
    check = "hold a direct voltage for ten seconds, then repeat at 1 kHz"
    needs = ("time_s",)
    knows_one_tone_only = True

    share: float = linear_parameter("1", 0.5, 0.3, (0.0, 0.999), off=0.0)
    time_constant_s: float = log_parameter("s", 1.7, 2.5, (1e-3, 1e5), off=1.0)
    corner_hz: float = log_parameter("Hz", 10.0, 5.0, (1e-4, 1e8), off=1.0)

    def drive(self, drive: Drive) -> Drive:
        built_up = -np.expm1(-np.maximum(drive.time_s, 0.0) / self.time_constant_s)
        return replace(
            drive,
            kept_square=drive.kept_square * self._kept(drive.frequency_hz, built_up),
            kept_offset_square=drive.kept_offset_square * self._kept(0.0, built_up),
        )

    def _kept(self, frequency_hz: Values, built_up: Values) -> Values:
        return 1.0 - self.share * built_up / (1.0 + (frequency_hz / self.corner_hz) ** 2)
