"""What a reading of the electrode's voltage and current is, and what an instrument that gives one
can do.
"""

from __future__ import annotations

from collections.abc import Callable
from math import nan
from typing import NamedTuple, Protocol


class ElectrodeReading(NamedTuple):
    """Voltage and current at the electrode at one frequency: peak phasors, and standard deviations
    of each part.

    Phases count from the generator's output if `referenced`, else from the electrode's voltage,
    whose own phase then is 0 and means nothing. A phase's own standard deviation is NaN where it is
    that of a part over the amount. `second_a` and `third_a` are the current's harmonics, peak; NaN
    where they are unknown.
    """

    voltage_v: complex
    voltage_std_v: float
    current_a: complex
    current_std_a: float
    second_a: float = nan
    third_a: float = nan
    referenced: bool = True
    voltage_phase_std_rad: float = nan
    current_phase_std_rad: float = nan


def nothing() -> None:
    """What is called where nobody waits."""


class ElectrodeMonitor(Protocol):
    """An instrument that reads the electrode. `drives`: it is a source of its own, wired in place
    of the amplifier.
    """

    drives: bool

    @property
    def frequency_range_hz(self) -> tuple[float, float]:
        """The lowest and the highest carrier that it measures."""

    def read(
        self, frequency_hz: float, voltage_v: float, alive: Callable[[], object] = nothing
    ) -> ElectrodeReading:
        """What is there now, under a carrier of `frequency_hz` and peak `voltage_v`; raises
        DeviceError.

        `alive` is called between parts of what takes long. One that drives puts that voltage on the
        electrode, and takes it off again before it returns or raises.
        """
