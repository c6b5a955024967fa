"""Charge trapped on the insulator pulls without voltage."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from model.effects.base import Effect, linear_parameter, log_parameter
from model.touch import Drive


@dataclass(frozen=True)
class TrappedCharge(Effect):
    """Mean square V^2/2 -> V^2/2 + V_s^2; for a biased drive (V_dc - V_s)^2.

    How much of it acts while nothing is driven, when leakage may screen it, is a parameter.
    """

    name = "trapped_charge"
    stage = "pressure"
    physics = "charge is trapped on the screen's surface"
    signature = (
        "attraction that remains without voltage; polarity of a bias matters; the current follows"
        " the pressure only"
    )
    check = "wipe the screen with a grounded damp cloth; reverse a steady voltage"
    removed_by = ("discharge",)
    knows_one_tone_only = True

    surface_voltage_v: float = log_parameter("V", 20.0, 2.5, (1e-3, 1e4), off=0.0)
    share_at_rest: float = linear_parameter("1", 0.5, 0.4, (0.0, 1.0), off=0.0)

    @classmethod
    def bends_with(cls) -> tuple[str, ...]:
        """On nothing: it is there whatever is driven."""
        return ()

    def drive(self, drive: Drive) -> Drive:
        driven = (drive.voltage_v != 0.0) | (drive.voltage_offset_v != 0.0)
        acting = np.where(
            driven, self.surface_voltage_v, self.surface_voltage_v * np.sqrt(self.share_at_rest)
        )
        return replace(drive, surface_voltage_v=acting)
