"""Water bridges pull the finger on, with or without voltage."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

from model.effects.base import Effect, Stage, log_parameter
from model.parameters import TouchParameters
from model.touch import Contact, Drive


@dataclass(frozen=True)
class CapillaryAdhesion(Effect):
    """A constant extra pressure."""

    name: ClassVar[str] = "capillary_adhesion"
    stage: ClassVar[Stage] = "load"
    physics: ClassVar[str] = "capillary bridges add to the load"
    source: ClassVar[str] = "starting point of the catalogue; ranges unverified"
    signature: ClassVar[str] = "more friction at light load without voltage too"
    check: ClassVar[str] = "wipe the finger dry; measure friction without voltage against load"

    pressure_pa: float = log_parameter("Pa", 400.0, 3.0, (1e-3, 1e7), off=0.0)

    def contact(self, contact: Contact, parameters: TouchParameters, drive: Drive) -> Contact:
        """See `Effect`."""
        return replace(contact, added_pressure_pa=contact.added_pressure_pa + self.pressure_pa)
