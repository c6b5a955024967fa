"""How steeply the model's force grows with voltage, beside what others measured.

Published fingers have force in proportion to the square of the voltage, up to 150 V: Meyer et al.
2013 (10.1109/WHC.2013.6548381), and the data set 4TU 08aa3d2d from 75 V on. The numbers are those
of `validation/published_voltage.csv`; docs/voltage-law.md compares the models.
"""

from __future__ import annotations

import numpy as np

from model.touch_model import TouchModel

PUBLISHED_EXPONENT = 2.0
PUBLISHED_UP_TO = 2.5  # above it the exponent is nearer to another whole number
PUBLISHED_V = 75.0, 150.0


def exponent(
    model: TouchModel, frequency_hz: float, voltage_v: float, normal_force_n: float
) -> float:
    """By which power of the voltage the force of a sine grows from 75 V to there; NaN without a
    force.
    """
    voltages_v = np.array([PUBLISHED_V[0], voltage_v])
    found = model.surface(np.array([frequency_hz]), voltages_v, np.array([normal_force_n]))
    low_n, high_n = found.electrostatic_force_n.ravel()
    if not 0.0 < low_n < high_n:
        return float("nan")
    return float(np.log(high_n / low_n) / np.log(voltage_v / PUBLISHED_V[0]))


def beyond_published(
    model: TouchModel, frequency_hz: float, voltage_v: float, normal_force_n: float
) -> str | None:
    """One sentence where the force is steeper than published fingers have it; None elsewhere."""
    low_v, high_v = PUBLISHED_V
    if voltage_v <= low_v:
        return None
    found = exponent(model, frequency_hz, voltage_v, normal_force_n)
    if not found > PUBLISHED_UP_TO:
        return None
    return (
        f"above {low_v:g} V the model '{model.description.name}' is steeper than published"
        f" fingers: its force grows with voltage to the power {found:.1f} up to {voltage_v:.4g} V"
        f" at {normal_force_n:.3g} N, theirs to the power {PUBLISHED_EXPONENT:g} up to"
        f" {high_v:g} V; friction there is in doubt (docs/voltage-law.md)"
    )
