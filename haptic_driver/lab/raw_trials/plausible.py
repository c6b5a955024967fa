"""What no touch, or no rig that does as it is told, has in a row: told beside the number."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from haptic_driver.lab.raw_trials.look import Doubt
from model.diagnosis.data import MEASURED, RANGES

SLIDES_M_S = 2.0  # no finger is led faster over a screen
APART = 1.5  # times; what was set and what was there are then two things
SET = {"electrode_voltage_v": "voltage_v", **MEASURED}  # what was measured, and what was set
Row = Mapping[str, str | float]


def doubts_of(row: Row) -> Iterator[Doubt]:
    """What is outside of the ranges of measured data, and what is far from what was set."""
    ranges = {**RANGES, "speed_m_s": (0.0, SLIDES_M_S, "m/s")}
    for name, (low, high, unit) in ranges.items():
        value = row.get(name, "")
        if not isinstance(value, str) and not low <= value <= high:
            within = f"{low:g} to {high:g} {unit}".strip()
            yield Doubt("impossible", f"{name} is {value:.3g}, outside {within}")
    for name, set_name in SET.items():
        value, wanted = row.get(name, ""), row.get(set_name, "")
        if isinstance(value, str) or isinstance(wanted, str) or not wanted:
            continue
        if not wanted / APART <= value <= wanted * APART:
            told = f"{name} is {value:.3g}, and {wanted:.3g} was set"
            yield Doubt("not_as_set", f"{told}: is a gain or a unit wrong?")
