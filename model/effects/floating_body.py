"""No ground strap: the body couples to ground through its capacitance only."""

from __future__ import annotations

from dataclasses import dataclass, replace

from model.effects.base import Effect, log_parameter
from model.electric.dielectrics import EPS0
from model.parameters import TouchParameters
from model.touch import Branch, Drive


@dataclass(frozen=True)
class FloatingBody(Effect):
    """h -> h + eps0 A0/C_b."""

    name = "floating_body"
    stage = "stack"
    physics = "the body floats on its capacitance to ground"
    signature = (
        "force falls at every frequency, least where leakage already limits it; less current,"
        " closer to 90 degrees, most at low frequency"
    )
    check = "put on a grounding strap"
    removed_by = ("strap",)

    # Two standard deviations: from 14 pF, of a hand alone, to 18 nF, of a body on grounded things,
    # which spectra see.
    body_capacitance_f: float = log_parameter("F", 5e-10, 6.0, (1e-14, 1e-2), off=float("inf"))

    def stack(self, branch: Branch, parameters: TouchParameters, drive: Drive) -> Branch:
        length_m = EPS0 * parameters.contact_area_m2 / self.body_capacitance_f
        return replace(branch, series_length_m=branch.series_length_m + length_m)
