"""The insulator conducts: charge reaches its surface (Johnsen-Rahbek)."""

from __future__ import annotations

from dataclasses import dataclass, replace

from model.effects.base import Effect, log_parameter
from model.electric.dielectrics import EPS0
from model.parameters import TouchParameters
from model.touch import Branch, Drive


@dataclass(frozen=True)
class JohnsenRahbek(Effect):
    """Conductivity sigma_1 of the insulator, added to the base model's."""

    name = "johnsen_rahbek"
    stage = "stack"
    physics = "the insulator leaks charge to its surface"
    source = "Johnsen and Rahbek 1923; range unverified"
    signature = "more force at low frequency; there more current, in phase with the voltage"
    check = (
        "hold a steady voltage: attraction grows over seconds; measure the insulator's resistance"
    )

    insulator_conductivity_s_per_m: float = log_parameter("S/m", 1e-9, 10.0, (1e-16, 1e-2), off=0.0)

    def stack(self, branch: Branch, parameters: TouchParameters, drive: Drive) -> Branch:
        conduction = self.insulator_conductivity_s_per_m / (1j * branch.omega * EPS0)
        return replace(branch, k_insulator=branch.k_insulator + conduction)
