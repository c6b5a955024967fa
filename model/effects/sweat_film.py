"""A share of the gap is filled with sweat."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from model.effects.base import Effect, linear_parameter, log_parameter
from model.electric.dielectrics import EPS0
from model.parameters import TouchParameters
from model.touch import Branch, Drive


@dataclass(frozen=True)
class SweatFilm(Effect):
    """A share phi of the gap has k = 80 + sigma_s/(j w eps0); how it lies there is a parameter.

    Films between air and skin are in series with the air, columns from skin to screen in parallel
    with it. In between, k^m = (1 - phi) k_air^m + phi k_sweat^m with m = -1 (series) to 1
    (parallel), Lichtenecker's rule. The field in the air is (k/k_air)^((1 - m)/2) times the mean
    field of the gap, exact at both ends.
    """

    name = "sweat_film"
    stage = "air gap"
    physics = "sweat fills a share of the air gap"
    source = "starting point of the catalogue; ranges unverified; mixing after Lichtenecker"
    signature = (
        "columns of sweat: less force, most at low frequency; films: narrower gaps, more force;"
        " more current either way, for columns in phase with the voltage"
    )
    check = "wipe the finger dry and repeat at once"
    removed_by = ("wipe",)
    # Sweat takes a share of air that conducts, or moist air one of sweat.
    order_counts_with = ("humid_gap_conduction",)

    # A few columns in parallel with the air tell as much as a film through half of it.
    share: float = log_parameter("1", 0.02, 8.0, (1e-9, 0.95), off=0.0)
    sweat_conductivity_s_per_m: float = log_parameter("S/m", 0.3, 4.0, (1e-6, 3.0), off=1.0)
    arrangement: float = linear_parameter("1", 0.0, 1.0, (-1.0, 1.0), off=1.0)

    def stack(self, branch: Branch, parameters: TouchParameters, drive: Drive) -> Branch:
        sweat = 80.0 + self.sweat_conductivity_s_per_m / (1j * branch.omega * EPS0)
        # stands for the rule's limit at 0
        m = np.where(np.abs(self.arrangement) < 1e-3, 1e-3, self.arrangement)
        air = branch.k_gap
        mixed = air * (1.0 + self.share * ((sweat / air) ** m - 1.0)) ** (1.0 / m)
        gain = (mixed / air) ** (0.5 * (1.0 - self.arrangement))
        return replace(branch, k_gap=mixed, field_gain=branch.field_gain * gain)
