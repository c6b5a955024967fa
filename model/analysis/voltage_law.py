"""How steeply the model's force grows with voltage, beside what others measured.

Published fingers have force in proportion to the square of the voltage, up to 150 V: Meyer et al.
2013 (10.1109/WHC.2013.6548381), and the data set 4TU 08aa3d2d from 75 V on. docs/voltage-law.md
compares the models.
"""

from __future__ import annotations

import numpy as np

from model.touch_model import TouchModel

PUBLISHED_EXPONENT = 2.0
PUBLISHED_V = 75.0, 150.0
STEP = 1.01  # of voltage, for the slope


def exponent(
    model: TouchModel, frequency_hz: float, voltage_v: float, normal_force_n: float
) -> float:
    """By which power of the voltage the force of a sine grows there; NaN without a force."""
    voltages_v = voltage_v * np.array([1.0 / STEP, STEP])
    found = model.surface(np.array([frequency_hz]), voltages_v, np.array([normal_force_n]))
    low_n, high_n = found.electrostatic_force_n.ravel()
    if not 0.0 < low_n < high_n:
        return float("nan")
    return float(np.log(high_n / low_n) / (2.0 * np.log(STEP)))


def beyond_published(
    model: TouchModel, frequency_hz: float, voltage_v: float, normal_force_n: float
) -> str | None:
    """One sentence where the force is steeper than published fingers have it; None elsewhere."""
    if voltage_v < PUBLISHED_V[0]:
        return None
    found = exponent(model, frequency_hz, voltage_v, normal_force_n)
    if not found > PUBLISHED_EXPONENT + 0.5:  # nearer to another whole power
        return None
    return (
        f"at {voltage_v:.4g} V and {normal_force_n:.3g} N the model's force grows with voltage"
        f" to the power {found:.1f}, that of published fingers to the power"
        f" {PUBLISHED_EXPONENT:g}, up to {PUBLISHED_V[1]:g} V: friction there is in doubt"
        " (docs/voltage-law.md)"
    )
