"""The field in the gap cannot exceed breakdown."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from model.effects.base import Effect, Stage, log_parameter
from model.parameters import TouchParameters
from model.touch import Contact, Drive


@dataclass(frozen=True)
class AirBreakdown(Effect):
    """The amplitude of the local field is capped at E_bd."""

    name: ClassVar[str] = "air_breakdown"
    stage: ClassVar[Stage] = "pressure"
    physics: ClassVar[str] = "air breaks down in the smallest gaps"
    source: ClassVar[str] = "starting point of the catalogue; ranges unverified"
    signature: ClassVar[str] = "force saturates at high voltage, most where the gaps are smallest"
    check: ClassVar[str] = "sweep the voltage: friction rises linearly at the end; look for light and a smell of ozone"

    breakdown_field_v_per_m: float = log_parameter("V/m", 5e7, 3.5, (1e4, 1e12), off=float("inf"))

    def contact(self, contact: Contact, parameters: TouchParameters, drive: Drive) -> Contact:
        """See `Effect`."""
        limit = np.minimum(contact.field_limit_v_per_m, self.breakdown_field_v_per_m)
        return replace(contact, field_limit_v_per_m=limit)
