"""A share of the gap is filled with sweat."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

from model.dielectrics import EPS0
from model.effects.base import Effect, Stage, log_parameter
from model.parameters import TouchParameters
from model.touch import Branch, Drive


@dataclass(frozen=True)
class SweatFilm(Effect):
    """k_gap -> (1 - phi) k_gap + phi (80 + sigma_s/(j w eps0))."""

    name: ClassVar[str] = "sweat_film"
    stage: ClassVar[Stage] = "air gap"
    physics: ClassVar[str] = "sweat fills a share of the air gap"
    source: ClassVar[str] = "starting point of the catalogue; ranges unverified"
    signature: ClassVar[str] = "less force, most at low frequency"
    check: ClassVar[str] = "wipe the finger dry and repeat at once"

    share: float = log_parameter("1", 0.01, 4.0, (1e-9, 0.9), off=0.0)
    sweat_conductivity_s_per_m: float = log_parameter("S/m", 1e-2, 30.0, (1e-10, 1e2), off=1.0)

    def stack(self, branch: Branch, parameters: TouchParameters, drive: Drive) -> Branch:
        """See `Effect`."""
        sweat = 80.0 + self.sweat_conductivity_s_per_m / (1j * branch.omega * EPS0)
        return replace(branch, k_gap=(1.0 - self.share) * branch.k_gap + self.share * sweat)
