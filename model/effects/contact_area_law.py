"""The touch spreads under load."""

from __future__ import annotations

from dataclasses import dataclass, replace

from model.effects.base import Effect, linear_parameter
from model.parameters import TouchParameters
from model.touch import LOAD_REFERENCE_N, Contact, Drive


@dataclass(frozen=True)
class ContactAreaLaw(Effect):
    """A = A_ref (F_n/F_ref)^n, F_ref = 0.5 N; pressure, attraction and current follow.

    A touch whose area was seen (`Drive.seen_area_m2`) has that area, whatever the law says.
    """

    name = "contact_area_law"
    stage = "contact"
    physics = "the touch spreads under load: its area is not the same at every load"
    source = "fingertips have n about 0.3 to 0.5, a Hertz-like contact 2/3; unverified for this rig"
    signature = (
        "attraction over load bends: more at heavy load, less at light; friction without voltage"
        " unchanged; the current grows with the load"
    )
    check = "film the touch through the screen at 0.2, 0.5 and 1 N"

    exponent: float = linear_parameter("1", 0.4, 0.12, (0.0, 1.2), off=0.0)

    def contact(self, contact: Contact, parameters: TouchParameters, drive: Drive) -> Contact:
        load = drive.normal_force_n / LOAD_REFERENCE_N
        return replace(contact, area_factor=contact.area_factor * load**self.exponent)
