"""Skin is stiffer when it is rubbed faster."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from model.effects.base import Effect, linear_parameter
from model.parameters import TouchParameters
from model.touch import SPEED_REFERENCE_M_S, Contact, Drive


@dataclass(frozen=True)
class ViscoelasticSkin(Effect):
    """Y* -> Y* (v/v_ref)^n, v_ref = 20 mm/s."""

    name = "viscoelastic_skin"
    stage = "contact"
    physics = "skin is viscoelastic"
    signature = (
        "less attraction at higher speed, friction without voltage unchanged; less current at"
        " higher speed, leak too"
    )
    check = "repeat at 5 and 50 mm/s, with and without voltage"
    needs = ("speed_m_s",)

    exponent: float = linear_parameter("1", 0.0, 0.2, (-3.0, 3.0), off=0.0)

    def contact(self, contact: Contact, parameters: TouchParameters, drive: Drive) -> Contact:
        factor = (np.maximum(drive.speed_m_s, 1e-6) / SPEED_REFERENCE_M_S) ** self.exponent
        return replace(contact, modulus_factor=contact.modulus_factor * factor)
