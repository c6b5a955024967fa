"""The field in the gap cannot exceed breakdown."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from model.effects.base import Effect, log_parameter
from model.parameters import TouchParameters
from model.touch import Contact, Drive


@dataclass(frozen=True)
class AirBreakdown(Effect):
    """The amplitude of the local field is capped at E_bd."""

    name = "air_breakdown"
    stage = "pressure"
    physics = "air breaks down in the smallest gaps"
    signature = (
        "force saturates at high voltage, most where the gaps are smallest; the current follows the"
        " pressure only, pulses of discharges are not modelled"
    )
    check = (
        "sweep the voltage: friction rises linearly at the end; look for light and a smell of ozone"
    )
    knows_one_tone_only = True

    breakdown_field_v_per_m: float = log_parameter("V/m", 1e8, 3.5, (1e4, 1e12), off=float("inf"))

    def contact(self, contact: Contact, parameters: TouchParameters, drive: Drive) -> Contact:
        limit = np.minimum(contact.field_limit_v_per_m, self.breakdown_field_v_per_m)
        return replace(contact, field_limit_v_per_m=limit)
