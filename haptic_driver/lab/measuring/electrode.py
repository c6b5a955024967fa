"""Readings of the electrode's voltage and current -> their mean, with its errors."""

from __future__ import annotations

from collections.abc import Sequence
from math import sqrt

import numpy as np

from hw.monitor.contract import ElectrodeReading


def mean_reading(readings: Sequence[ElectrodeReading]) -> ElectrodeReading | None:
    """The mean of n readings; None of none, and of a monitor that shows nothing at all.

    The errors of amount and phase are those of the readings, or what their scatter implies where
    that is more: then the touch itself changed.
    """
    if not all(reading.voltage_v and reading.current_a for reading in readings) or not readings:
        return None
    voltage_v, voltage_std, voltage_phase_std_rad = _mean(
        [(r.voltage_v, r.voltage_std_v) for r in readings]
    )
    current_a, current_std, current_phase_std_rad = _mean(
        [(r.current_a, r.current_std_a) for r in readings]
    )
    return ElectrodeReading(
        voltage_v,
        voltage_std * abs(voltage_v),
        current_a,
        current_std * abs(current_a),
        float(np.mean([r.second_a for r in readings])),
        float(np.mean([r.third_a for r in readings])),
        readings[0].referenced,
        voltage_phase_std_rad,
        current_phase_std_rad,
    )


def _mean(parts: Sequence[tuple[complex, float]]) -> tuple[complex, float, float]:
    """Mean of phasors with their errors, and the standard errors of its amount, relative, and of
    its phase.
    """
    phasors, stds = (np.array(column) for column in zip(*parts, strict=True))
    n, mean = len(parts), complex(np.mean(phasors))
    stated = sqrt(float(np.mean(stds**2)) / n) / abs(mean)
    off = phasors / mean - 1.0
    scatter = [
        sqrt(float(np.sum(part**2)) / ((n - 1) * n)) if n > 1 else 0.0
        for part in (off.real, off.imag)
    ]
    return mean, max(stated, scatter[0]), max(stated, scatter[1])
