"""A sliding finger rides higher."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from model.effects.base import Effect, log_parameter
from model.parameters import TouchParameters
from model.touch import Contact, Drive


@dataclass(frozen=True)
class SpeedDependentGap(Effect):
    """u -> u + du (1 - exp(-v/v0))."""

    name = "speed_dependent_gap"
    stage = "air gap"
    physics = "sliding lifts the skin off the screen"
    source = "Shultz 2018: the gap's impedance rises 100 to 1000 % when sliding; ranges unverified"
    signature = (
        "less force at higher speed, at every frequency; less current there, but for the leak"
    )
    check = "repeat at 5 and 50 mm/s"
    needs = ("speed_m_s",)

    lift_m: float = log_parameter("m", 4e-7, 5.0, (1e-10, 1e-3), off=0.0)
    speed_scale_m_s: float = log_parameter("m/s", 0.02, 2.5, (1e-5, 10.0), off=1.0)

    def contact(self, contact: Contact, parameters: TouchParameters, drive: Drive) -> Contact:
        lift_m = self.lift_m * -np.expm1(-drive.speed_m_s / self.speed_scale_m_s)
        return replace(contact, gap_shift_m=contact.gap_shift_m + lift_m)
