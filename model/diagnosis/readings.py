"""How else a table may be meant: some of its columns in another unit, or with another sign.

A table that is read in a wrong unit looks like an effect, as frequencies in kHz like wet skin. So
each other reading is a hypothesis: nothing is missing, and the columns mean something else. It is
not of the touch, and its check is a look at the file.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from math import pi, sqrt
from typing import NamedTuple

import numpy as np

from model.diagnosis.data import RANGES, Measurements
from model.diagnosis.hypotheses import OUTSIDE
from model.diagnosis.priors import LOG_PRIOR_EACH

VOLTAGES = ("voltage_v", "voltage_offset_v", "electrode_voltage_v")
GRAM_N = 9.80665e-3  # standard gravity


class Reading(NamedTuple):
    """What its columns hold, and by which factor they become ours.

    `against_name`: the unit is not that in the column's name, which takes two mistakes.
    """

    said: str
    factors: Mapping[str, float]
    against_name: bool = False

    @property
    def name(self) -> str:
        """As a hypothesis."""
        return f"a table with {self.said}"

    @property
    def check(self) -> str:
        """What to do where it is likely."""
        column, factor = next(iter(self.factors.items()))
        unit, said = RANGES[column][2], f"--column {column}=NAME"
        look = "look at the file before the rig or the finger"
        so, not_so = f"{said}:{factor:.6g}{unit}", f"{said}:{unit}"
        return f"{look}; if so, {so}, if not, {not_so} (NAME: in the file)"

    def of(self, data: Measurements) -> Measurements:
        """The data as they are then."""
        changed = {
            name: factor * data.columns[name]
            for name, factor in self.factors.items()
            if name in data.columns
        }
        return replace(data, columns={**data.columns, **changed})


# By which voltages differ from peak amplitudes, and what they are then.
VOLTAGES_MEANT = {
    0.5: "peak to peak",
    sqrt(0.5): "peak values, taken for rms and converted",
    sqrt(2.0): "rms",
    2.0: "those of a generator that is set for 50 ohm and drives a high impedance",
}
READINGS = (
    *(
        Reading(f"voltages that are {words}", dict.fromkeys(VOLTAGES, factor))
        for factor, words in VOLTAGES_MEANT.items()
    ),
    Reading("electrode voltages that are peak to peak", {"electrode_voltage_v": 0.5}),
    Reading("electrode voltages that are rms", {"electrode_voltage_v": sqrt(2.0)}),
    Reading("currents that are peak to peak", {"current_a": 0.5}),
    Reading("currents that are rms", {"current_a": sqrt(2.0)}),
    Reading("currents in mA", {"current_a": 1e-3}, against_name=True),
    Reading("phases that count the other way", {"current_phase_rad": -1.0}),
    Reading("frequencies in kHz", {"frequency_hz": 1e3}, against_name=True),
    Reading("frequencies in rad/s", {"frequency_hz": 0.5 / pi}, against_name=True),
    Reading("loads in mN", {"normal_force_n": 1e-3}, against_name=True),
    Reading("loads in grams", {"normal_force_n": GRAM_N}, against_name=True),
)
CHECKS = OUTSIDE | {one.name: one.check for one in READINGS}  # of all that is not of the touch


def other_readings(data: Measurements) -> list[Reading]:
    """Those that change what these data say, and leave every number in the range of measured data.

    None of columns whose unit is sure.
    """
    return [r for r in READINGS if not data.sure & set(r.factors) and _is_possible(r, data)]


def _is_possible(reading: Reading, data: Measurements) -> bool:
    changed = False
    for name, factor in reading.factors.items():
        values = data.columns.get(name, np.zeros(0))
        values = factor * values[np.isfinite(values) & (values != 0.0)]
        low, high, _ = RANGES[name]
        if not np.all((np.abs(values) >= low) & (np.abs(values) <= high)):
            return False
        changed |= bool(values.size)
    return changed


def evidences(data: Measurements, evidence_of: Callable[[Measurements], float]) -> dict[str, float]:
    """log evidence of each other reading by its name; together they are as probable as one effect.

    One against the names of its columns is as improbable as two. `evidence_of`: that nothing is
    missing from what the data then are.
    """
    found = other_readings(data)
    share = float(np.log(len(found))) if found else 0.0
    priors = {one.name: LOG_PRIOR_EACH * one.against_name - share for one in found}
    return {one.name: evidence_of(one.of(data)) + priors[one.name] for one in found}
