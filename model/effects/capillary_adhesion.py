"""Water bridges pull the finger on, with or without voltage."""

from __future__ import annotations

from dataclasses import dataclass, replace

from model.effects.base import Effect, log_parameter
from model.parameters import TouchParameters
from model.touch import Contact, Drive


@dataclass(frozen=True)
class CapillaryAdhesion(Effect):
    """A constant extra pressure."""

    name = "capillary_adhesion"
    stage = "load"
    physics = "capillary bridges add to the load"
    signature = (
        "more friction at light load without voltage too; more current at light load, as under more"
        " load"
    )
    check = "wipe the finger dry; measure friction without voltage against load"
    removed_by = ("dry_air",)

    pressure_pa: float = log_parameter("Pa", 400.0, 3.0, (1e-3, 1e7), off=0.0)

    def contact(self, contact: Contact, parameters: TouchParameters, drive: Drive) -> Contact:
        return replace(contact, added_pressure_pa=contact.added_pressure_pa + self.pressure_pa)
