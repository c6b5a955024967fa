"""Humid air conducts in the gap."""

from __future__ import annotations

from dataclasses import dataclass, replace

from model.effects.base import Effect, log_parameter
from model.electric.dielectrics import EPS0
from model.parameters import TouchParameters
from model.touch import Branch, Drive


@dataclass(frozen=True)
class HumidGapConduction(Effect):
    """Conductivity sigma_g of the gap, added to the base model's."""

    name = "humid_gap_conduction"
    stage = "air gap"
    physics = "moist air and surface films conduct through the gap"
    signature = (
        "less force at low frequency, most for wide gaps and light loads; there more current, in"
        " phase with the voltage"
    )
    check = "blow dry air over the screen; change the room's humidity"
    removed_by = ("dry_air",)

    gap_conductivity_s_per_m: float = log_parameter("S/m", 3e-9, 10.0, (1e-16, 1e2), off=0.0)

    def stack(self, branch: Branch, parameters: TouchParameters, drive: Drive) -> Branch:
        conduction = self.gap_conductivity_s_per_m / (1j * branch.omega * EPS0)
        return replace(branch, k_gap=branch.k_gap + conduction)
