"""Skin conducts better under voltage."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from model.effects.base import Effect, log_parameter
from model.electric.layers import leak_per_m_pa
from model.parameters import TouchParameters
from model.support.arrays import Values
from model.touch import Branch, Drive

NEWTON_STEPS = 6  # from at most twice as far as the root: to the last digit
TINY = 1e-150


@dataclass(frozen=True)
class SkinNonlinearity(Effect):
    """sigma_2 -> sigma_2 (1 + (|V_skin|/V0)^2), V_skin being what is across the skin while it
    conducts that well.

    The skin's current has come through insulator and gap. Deep in the skin, where it has spread, it
    is that of a mean gap. How wide that is, is a parameter. The leak beside that gap is the one
    under the applied load, of a skin without voltage.
    """

    name = "skin_nonlinearity"
    stage = "stack"
    physics = "the skin's conductivity rises with the voltage across it"
    signature = (
        "a change at low frequency that grows faster than V^2; there the current grows faster than"
        " V, and its phase falls"
    )
    check = "sweep the voltage at 10 Hz: friction rises less than with V^2"
    # The skin's share of the voltage, before or after the rest changes.
    order_counts_with = (
        "series_resistance",
        "floating_body",
        "skin_hydration",
        "johnsen_rahbek",
        "humid_gap_conduction",
        "sweat_film",
    )

    voltage_scale_v: float = log_parameter("V", 4.0, 8.0, (1e-3, 1e9), off=float("inf"))
    gap_m: float = log_parameter("m", 7e-6, 2.0, (1e-9, 1e-3), off=7e-6)

    def stack(self, branch: Branch, parameters: TouchParameters, drive: Drive) -> Branch:
        leak_per_m = (
            leak_per_m_pa(parameters, branch) * drive.normal_force_n / parameters.contact_area_m2
        )
        gap_m = self.gap_m / (branch.k_gap + leak_per_m * self.gap_m)
        others = (
            branch.h_m(parameters) - branch.skin_length_m(parameters) + gap_m
        ) / parameters.skin_thickness_m
        real, imaginary = np.real(branch.k_skin), np.imag(branch.k_skin)
        voltage = np.asarray(drive.voltage_v / self.voltage_scale_v)
        factor = _factor(1.0 + others * real, 1j * others * imaginary, voltage)
        return replace(branch, k_skin=real + 1j * imaginary * factor)


def _factor(fixed: Values, growing: Values, voltage: Values) -> Values:
    """F with F = 1 + |voltage/(fixed + growing F)|^2.

    A cubic that is convex from 1 up: Newton's steps from above stay above its one root there.
    """
    # as if the voltage across the skin did not fall
    weakest = voltage**2 / np.abs(fixed + growing) ** 2
    # as if nothing but that held it back
    strongest = np.cbrt((voltage / np.maximum(np.abs(growing), TINY)) ** 2)
    factor = 1.0 + np.minimum(weakest, strongest)
    for _ in range(NEWTON_STEPS):
        hold = fixed + growing * factor
        excess = (factor - 1.0) * np.abs(hold) ** 2 - voltage**2
        slope = np.abs(hold) ** 2 + 2.0 * (factor - 1.0) * np.real(hold * np.conj(growing))
        factor = factor - excess / slope
    return factor
