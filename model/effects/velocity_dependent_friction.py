"""Friction depends on sliding speed."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from model.effects.base import Effect, linear_parameter
from model.touch import SPEED_REFERENCE_M_S, Drive, Friction


@dataclass(frozen=True)
class VelocityDependentFriction(Effect):
    """mu_off -> mu_off (v/v_ref)^s, v_ref = 20 mm/s."""

    name = "velocity_dependent_friction"
    stage = "friction"
    physics = "skin friction is not Coulomb's in speed"
    signature = "friction without voltage depends on speed; no trace in the current"
    check = "measure friction without voltage at 5 and 50 mm/s"
    needs = ("speed_m_s",)

    exponent: float = linear_parameter("1", 0.0, 0.15, (-2.0, 2.0), off=0.0)

    def friction(self, friction: Friction, drive: Drive) -> Friction:
        factor = (np.maximum(drive.speed_m_s, 1e-6) / SPEED_REFERENCE_M_S) ** self.exponent
        return replace(friction, cof_off_factor=friction.cof_off_factor * factor)
