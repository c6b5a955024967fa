"""Wetter or drier skin than the data set's."""

from __future__ import annotations

from dataclasses import dataclass, replace

from model.effects.base import Effect, linear_parameter
from model.parameters import TouchParameters
from model.touch import Branch, Drive


@dataclass(frozen=True)
class SkinHydration(Effect):
    """sigma_2 -> sigma_2 14^w, eps_2' -> eps_2' 1.5^w."""

    name = "skin_hydration"
    stage = "stack"
    physics = "the stratum corneum holds more (w > 0) or less water"
    source = "Bjorklund 2013, PMC3686338, for the two factors"
    signature = (
        "less force at low frequency (more leakage), more force at high frequency; more current,"
        " closer to the voltage's phase"
    )
    check = "measure skin hydration (corneometer); wait or wash and dry the finger"

    wetness: float = linear_parameter("1", 0.0, 0.5, (-4.0, 4.0), off=0.0)

    def stack(self, branch: Branch, parameters: TouchParameters, drive: Drive) -> Branch:
        skin = branch.k_skin
        wet = skin.real * 1.5**self.wetness + 1j * skin.imag * 14.0**self.wetness
        return replace(branch, k_skin=wet)
