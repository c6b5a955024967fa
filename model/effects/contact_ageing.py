"""Friction drifts as the contact ages."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from model.effects.base import Effect, linear_parameter, log_parameter
from model.touch import Drive, Friction


@dataclass(frozen=True)
class ContactAgeing(Effect):
    """mu_off(t) = mu_inf - (mu_inf - mu_0) exp(-t/T), as a share of mu_inf."""

    name = "contact_ageing"
    stage = "friction"
    physics = "the contact softens, moistens or wears in over time"
    source = (
        "finger pads on glass under occlusion, several-fold: 10.1007/s11249-011-9828-0; ranges"
        " unverified"
    )
    signature = "friction without voltage drifts along the measurement; no trace in the current"
    check = "repeat the first condition at the end"
    needs = ("time_s",)

    share: float = linear_parameter("1", 0.0, 0.35, (-3.0, 0.95), off=0.0)
    time_constant_s: float = log_parameter("s", 60.0, 5.0, (1e-3, 1e7), off=1.0)

    def friction(self, friction: Friction, drive: Drive) -> Friction:
        factor = 1.0 - self.share * np.exp(-np.maximum(drive.time_s, 0.0) / self.time_constant_s)
        return replace(friction, cof_off_factor=friction.cof_off_factor * factor)
