"""Touches for the tests of the physics, of scalars and lists."""

from __future__ import annotations

from typing import Any

import numpy as np

from model.conditions import Conditions


def touches(
    frequency_hz: Any, voltage_v: Any, normal_force_n: Any = 0.5, **columns: Any
) -> Conditions:
    """Columns of one length."""
    given = {"frequency_hz": frequency_hz, "voltage_v": voltage_v, "normal_force_n": normal_force_n}
    given |= columns
    arrays = np.broadcast_arrays(*(np.atleast_1d(x) for x in given.values()))
    return Conditions(**dict(zip(given, arrays, strict=True)))
