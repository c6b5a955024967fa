"""What one row's stroke was like: forces and monitors at each look, and where the finger was."""

from __future__ import annotations

from collections.abc import Sequence
from math import nan
from typing import NamedTuple

import numpy as np

from haptic_driver.lab.measuring.bench import Bench, Place
from haptic_driver.lab.measuring.plan import Row
from haptic_driver.lab.strokes.file import SAMPLE, KeptStroke, StrokeRow
from haptic_driver.signals import Array
from hw.force.sensor import ForceReading


class _Look(NamedTuple):
    at_s: float  # on the bench's clock
    time_s: float
    lateral_force_n: float
    normal_force_n: float
    monitor_voltage_v: float
    monitor_current_a: float


class Trace:
    """Collects the looks of one row; `settles` and `steady` mark when its parts begin."""

    def __init__(self, bench: Bench) -> None:
        self._bench = bench
        self._looks: list[_Look] = []
        self._settles_s = self._steady_s = nan

    def look(self, force: ForceReading | None = None) -> None:
        """Keep a reading, or take one, with the amplifier's monitors and the sensor's readings
        since the last look.
        """
        newest = force or self._bench.read_force()
        now_s = self._bench.time_s
        volts, amperes = (nan if x is None else x for x in self._bench.rig.read_monitors())
        told = self._bench.forces(newest)
        for reading in told if self._looks else [newest]:  # what came before is another row's
            at_s = now_s + reading.time_s - newest.time_s
            forces_n = reading.lateral_force_n, reading.normal_force_n
            if not self._looks or reading.time_s > self._looks[-1].time_s:  # it is news
                self._looks.append(_Look(at_s, reading.time_s, *forces_n, volts, amperes))

    def settles(self) -> None:
        """The voltage is up: displacement counts from here."""
        self._settles_s = self._bench.time_s

    def steady(self) -> None:
        """The steady window begins; it lasts until the end."""
        self._steady_s = self._bench.time_s

    def stroke(self, number: int, row: Row) -> KeptStroke:
        """All of it, of the row that is the data file's line `number` below its header."""
        looks = np.array(self._looks)
        samples = np.zeros(len(looks), SAMPLE)
        at_s, *columns = looks.T
        for name, column in zip(_Look._fields[1:], columns, strict=True):
            samples[name] = column
        marks_s = np.array([self._settles_s, self._steady_s, at_s[-1]])
        position_m, velocity_m_s = _slide(np.append(at_s, marks_s), self._bench.places)
        samples["position_m"], samples["velocity_m_s"] = position_m[:-3], velocity_m_s[:-3]
        zero_m, begin_m, end_m = position_m[-3:].tolist()
        samples["displacement_m"] = samples["position_m"] - zero_m
        samples["steady"] = at_s > self._steady_s
        setting = row.setting
        told = StrokeRow(
            number,
            row.session,
            row.trial,
            setting.frequency_hz,
            setting.voltage_v,
            setting.normal_force_n,
            setting.speed_m_s,
            setting.voltage_offset_v,
            setting.waveform,
            begin_m - zero_m,
            end_m - zero_m,
        )
        return KeptStroke(told, samples)


def _slide(time_s: Array, places: Sequence[Place]) -> tuple[Array, Array]:
    """Position and velocity at times [n], from places at two times or more."""
    by_time = dict(places)
    at_s, position_m = np.array(list(by_time)), np.array(list(by_time.values()))
    velocity_m_s = np.diff(position_m) / np.diff(at_s)
    middle_s = 0.5 * (at_s[1:] + at_s[:-1])
    return np.interp(time_s, at_s, position_m), np.interp(time_s, middle_s, velocity_m_s)
