"""The witnesses (observed quantities) of the touch: friction, the electrode's voltage and current,
and the apparent area of contact as a camera sees it.

Amounts are compared as logarithms, phases in rad. A current beside a measured electrode voltage is
divided by it, so the amplifier's effect cancels. The voltage's own witnesses show that effect.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from model.support.arrays import Array

# Relative, or rad; judged: no monitor's response is known better over decades of frequency, and a
# finger of the blind generator with nothing hidden is unexplained where its current is believed to
# 1e-4, but not with this.
LEAST_STD = 3e-3


@dataclass(frozen=True)
class Witness:
    """One column of a data file that the model predicts.

    `std` is the column of its standard deviation; `usual_std` (relative, or rad) stands for it
    where neither that nor replicates say it. `gain_std` is what all rows of a session share. It
    comes from electrodes, washing and posture for friction and area, and from the monitors' gain
    and delay for the others. `against` is a column that it is compared with where that is measured
    in the same row. `least_std` (relative, or rad) is what no rig, or no model of a touch, is
    better than from row to row, whatever its instrument resolves.
    """

    column: str
    std: str
    words: str
    gain_std: float
    usual_std: float | None
    is_phase: bool = False
    against: str = ""
    least_std: float = LEAST_STD
    range: tuple[float, float, str] = (-np.inf, np.inf, "")

    @property
    def unit(self) -> str:
        """Of a difference between measured and predicted, as pictures show it."""
        return "0.01 rad" if self.is_phase else "%"


WITNESSES = (
    Witness("cof", "cof_std", "friction", 0.05, None, least_std=1e-4, range=(1e-3, 20.0, "")),
    Witness(
        "current_a",
        "current_std_a",
        "current",
        0.02,
        0.02,
        against="electrode_voltage_v",
        range=(1e-12, 100.0, "A"),
    ),
    Witness(
        "current_phase_rad",
        "current_phase_std_rad",
        "current's phase",
        0.01,
        0.035,
        is_phase=True,
        against="electrode_voltage_phase_rad",
        range=(-10.0, 10.0, "rad"),
    ),
    Witness(
        "electrode_voltage_v",
        "electrode_voltage_std_v",
        "electrode's voltage",
        0.01,
        0.01,
        range=(1e-6, 1e4, "V"),
    ),
    Witness(
        "electrode_voltage_phase_rad",
        "electrode_voltage_phase_std_rad",
        "voltage's phase",
        0.01,
        0.01,
        is_phase=True,
        range=(-10.0, 10.0, "rad"),
    ),
    Witness(
        "contact_area_m2",
        "contact_area_std_m2",
        "contact area",
        0.03,
        0.03,
        least_std=0.01,
        range=(1e-7, 1e-2, "m^2"),
    ),
)
FRICTION, CURRENT, CURRENT_PHASE, VOLTAGE, VOLTAGE_PHASE, CONTACT_AREA = range(6)
BY_COLUMN = {witness.column: witness for witness in WITNESSES}


def observed(witness: Witness, columns: dict[str, Array]) -> Array:
    """Rows [n] of one witness as they are compared: logarithms, or rad, less what they are taken
    against.
    """
    values = columns[witness.column]
    value = values if witness.is_phase else np.log(values)
    if witness.against not in columns:
        return value
    against = columns[witness.against]
    return np.asarray(value - np.nan_to_num(against if witness.is_phase else np.log(against)))


def stated_std(witness: Witness, columns: dict[str, Array]) -> Array:
    """Standard deviation [n] of that as the file states it, NaN where it does not."""
    nothing = np.full(columns[witness.column].size, np.nan)
    std = columns.get(witness.std, nothing)
    own = std if witness.is_phase else std / columns[witness.column]
    if witness.against not in columns:
        return own
    other = BY_COLUMN[witness.against]
    more = np.nan_to_num(stated_std(other, columns), nan=other.usual_std or 0.0)
    return np.where(np.isfinite(columns[witness.against]), np.hypot(own, more), own)
