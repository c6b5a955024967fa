"""Friction falls as the finger starts to slide: an effect that the catalogue does not have."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from model.effects.base import Effect, log_parameter
from model.touch import Drive, Friction


@dataclass(frozen=True)
class StribeckFriction(Effect):
    """mu_off -> mu_off (1 + rise exp(-v/v_s)): more than the sliding value at rest."""

    name = "stribeck_friction"
    stage = "friction"
    physics = "a film of sweat is sheared where the skin slides fast, and pressed out where not"
    source = "exponential after Tustin 1947; ranges unverified"
    signature = "friction without voltage falls with speed and stays; no trace in the current"
    check = "measure friction without voltage at 1, 5 and 50 mm/s"
    needs = ("speed_m_s",)
    removed_by = ("wipe",)

    rise: float = log_parameter("1", 0.3, 3.0, (1e-4, 100.0), off=0.0)
    speed_scale_m_s: float = log_parameter("m/s", 0.02, 2.5, (1e-5, 10.0), off=1.0)

    def friction(self, friction: Friction, drive: Drive) -> Friction:
        factor = 1.0 + self.rise * np.exp(-np.abs(drive.speed_m_s) / self.speed_scale_m_s)
        return replace(friction, cof_off_factor=friction.cof_off_factor * factor)
