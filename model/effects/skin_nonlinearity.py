"""Skin conducts better under voltage."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from model.effects.base import Effect, log_parameter
from model.parameters import TouchParameters
from model.touch import Branch, Drive


@dataclass(frozen=True)
class SkinNonlinearity(Effect):
    """sigma_2 -> sigma_2 (1 + (|V_skin|/V0)^2), V_skin being the skin's share of V where insulator and skin touch."""

    name = "skin_nonlinearity"
    stage = "stack"
    physics = "the skin's conductivity rises with the voltage across it"
    signature = (
        "a change at low frequency that grows faster than V^2; there the current grows faster than V, and its phase "
        "falls"
    )
    check = "sweep the voltage at 10 Hz: friction rises less than with V^2"

    voltage_scale_v: float = log_parameter("V", 50.0, 6.0, (1e-3, 1e9), off=float("inf"))

    def stack(self, branch: Branch, parameters: TouchParameters, drive: Drive) -> Branch:
        """See `Effect`."""
        share = np.abs(branch.skin_length_m(parameters) / branch.h_m(parameters))
        factor = 1.0 + (share * drive.voltage_v / self.voltage_scale_v) ** 2
        return replace(branch, k_skin=branch.k_skin.real + 1j * branch.k_skin.imag * factor)
