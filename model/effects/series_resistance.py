"""A resistance in series: electrode film, leads, body."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

from model.effects.base import Effect, Stage, log_parameter
from model.electric.dielectrics import EPS0
from model.parameters import TouchParameters
from model.touch import Branch, Drive


@dataclass(frozen=True)
class SeriesResistance(Effect):
    """h -> h + j w eps0 R A0."""

    name: ClassVar[str] = "series_resistance"
    stage: ClassVar[Stage] = "stack"
    physics: ClassVar[str] = "a resistance in series with the touch takes voltage at high frequency"
    source: ClassVar[str] = "starting point of the catalogue; ranges unverified"
    signature: ClassVar[str] = "force falls at high frequency, more under higher load"
    check: ClassVar[str] = "measure the electrode film end to end; touch nearer to the contact of the electrode"

    resistance_ohm: float = log_parameter("ohm", 2e4, 8.0, (1e-2, 1e10), off=0.0)

    def stack(self, branch: Branch, parameters: TouchParameters, drive: Drive) -> Branch:
        """See `Effect`."""
        length_m = 1j * branch.omega * EPS0 * self.resistance_ohm * parameters.contact_area_m2
        return replace(branch, series_length_m=branch.series_length_m + length_m)
