"""A resistance in series: electrode film, leads, body."""

from __future__ import annotations

from dataclasses import dataclass, replace

from model.effects.base import Effect, log_parameter
from model.electric.dielectrics import EPS0
from model.parameters import TouchParameters
from model.touch import Branch, Drive


@dataclass(frozen=True)
class SeriesResistance(Effect):
    """h -> h + j w eps0 R A0."""

    name = "series_resistance"
    stage = "stack"
    physics = "a resistance in series with the touch takes voltage at high frequency"
    signature = (
        "force falls at high frequency, more under higher load; the touch's current ends at V/R, in"
        " phase with the voltage, while the electrode's voltage stays"
    )
    check = "measure the electrode film end to end; touch nearer to the contact of the electrode"

    # Two standard deviations: from 90 ohm, of leads, which spectra see, to 4.5 Mohm, of a broken
    # electrode film.
    resistance_ohm: float = log_parameter("ohm", 2e4, 15.0, (1e-2, 1e10), off=0.0)

    def stack(self, branch: Branch, parameters: TouchParameters, drive: Drive) -> Branch:
        length_m = 1j * branch.omega * EPS0 * self.resistance_ohm * parameters.contact_area_m2
        return replace(branch, series_length_m=branch.series_length_m + length_m)
