"""A resistance with a constant-phase element across the gap."""

from __future__ import annotations

from dataclasses import dataclass, replace

from model.effects.base import Effect, linear_parameter, log_parameter
from model.parameters import TouchParameters
from model.touch import Branch, Drive


@dataclass(frozen=True)
class ElectrodePolarization(Effect):
    """Admittance per area 1/(R_ct + 1/(Q (j w)^n)) in parallel with the air gap."""

    name = "electrode_polarization"
    stage = "air gap"
    physics = "charge transfer and a double layer bridge the air gap"
    source = "10.1002/aisy.202300618; ranges unverified"
    signature = (
        "less force at low frequency, by a power of frequency; current rises by that power, at a"
        " phase between 0 and 90 degrees that hardly changes"
    )
    check = "measure the impedance of the touch between 10 Hz and 1 kHz; wipe finger and screen dry"
    removed_by = ("wipe",)

    transfer_resistance_ohm_m2: float = log_parameter(
        "ohm m^2", 30.0, 8.0, (1e-6, 1e12), off=float("inf")
    )
    # Of the apparent area: a double layer has some 0.1 where it touches, and a finger touches with
    # 1e-7 to 0.1 of that.
    admittance_s_sn_per_m2: float = log_parameter("S s^n/m^2", 3e-5, 30.0, (1e-12, 1e6), off=1.0)
    exponent: float = linear_parameter("1", 0.75, 0.15, (0.3, 1.0), off=1.0)

    def stack(self, branch: Branch, parameters: TouchParameters, drive: Drive) -> Branch:
        element = 1.0 / (self.admittance_s_sn_per_m2 * (1j * branch.omega) ** self.exponent)
        admittance = 1.0 / (self.transfer_resistance_ohm_m2 + element)
        return replace(branch, gap_admittance_s_per_m2=branch.gap_admittance_s_per_m2 + admittance)
