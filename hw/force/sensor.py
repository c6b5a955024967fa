"""Force on the touch screen, from whatever sensor the rig has."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from math import nan
from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np

from hw.errors import DeviceError
from hw.force.ati_calibration import Array, AtiCalibration


class ForceReading(NamedTuple):
    """One reading: time on the sensor's clock, force pressing on the screen (> 0), force along the
    sliding direction.

    `saturated` is True when a channel was at the end of its range, or the sensor reported a fault
    of its own. The numbers are then not to be trusted.
    """

    time_s: float
    normal_force_n: float
    lateral_force_n: float
    saturated: bool


class ForceSensor(Protocol):
    """A source of force readings."""

    def read(self) -> ForceReading:
        """Return the newest reading. Raises DeviceError."""


@runtime_checkable
class KeepsReadings(Protocol):
    """A force sensor that keeps every reading, however seldom it is asked."""

    def take_readings(self) -> list[ForceReading]:
        """Return all since the last call, oldest first, or the latest thousands. Raises
        DeviceError.
        """


@dataclass(frozen=True)
class NoForceSensor:
    """Nothing that measures force: the load is taken for `load_n`, the lateral force stays unknown
    (NaN).
    """

    load_n: float
    clock: Callable[[], float] = time.monotonic

    def read(self) -> ForceReading:
        """What is taken for the force."""
        return ForceReading(self.clock(), self.load_n, nan, False)


class Wrench(NamedTuple):
    """What a six-axis sensor feels in its own axes: (Fx, Fy, Fz) in N, (Tx, Ty, Tz) in N m;
    `saturated` as above.
    """

    time_s: float
    force_n: tuple[float, float, float]
    torque_n_m: tuple[float, float, float]
    saturated: bool


@dataclass(frozen=True)
class ForceAxes:
    """How the sensor is mounted: the signed axes ("x", "-z") whose force is > 0 when pressing and
    along the slide.

    Raises ValueError for anything else and for the same axis twice.
    """

    normal: str
    lateral: str

    def __post_init__(self) -> None:
        """Refuse what is no axis."""
        for name, axis in vars(self).items():
            if axis.lstrip("+-") not in ("x", "y", "z") or len(axis) > 2:
                raise ValueError(f"{name} axis must be one of x, y, z, -x, -y, -z, not {axis!r}")
        if self.normal[-1] == self.lateral[-1]:
            raise ValueError(
                f"normal and lateral axis must differ, not {self.normal!r} and {self.lateral!r}"
            )

    def reading(self, wrench: Wrench) -> ForceReading:
        """`wrench` seen from the screen."""
        normal_n, lateral_n = (_along(axis, wrench.force_n) for axis in (self.normal, self.lateral))
        return ForceReading(wrench.time_s, normal_n, lateral_n, wrench.saturated)


def _along(axis: str, force_n: tuple[float, float, float]) -> float:
    return force_n["xyz".index(axis[-1])] * (-1.0 if axis.startswith("-") else 1.0)


class GaugeSource(Protocol):
    """The sensor's strain gauges on analog inputs."""

    def latest_v(self, count: int) -> Array:
        """Return the newest `count` samples, shape (count, 6), V. Raises DeviceError."""


class GaugeForceSensor:
    """An ATI transducer whose gauges are read by an analog input card.

    A reading is the mean of the newest `samples_per_reading` samples: one step of a 16-bit card is
    some mN. Saturation is looked for in every sample, before the mean hides it. Nothing is read
    before `take_bias`.
    """

    def __init__(
        self,
        gauges: GaugeSource,
        calibration: AtiCalibration,
        axes: ForceAxes,
        *,
        samples_per_reading: int,
        samples_per_bias: int,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._gauges = gauges
        self._calibration = calibration
        self._axes = axes
        self._samples_per_reading = samples_per_reading
        self._samples_per_bias = samples_per_bias
        self._clock = clock
        self._bias_v: Array | None = None

    def take_bias(self) -> Array:
        """Take the unloaded gauges as zero; return their mean, V. Raises DeviceError when a gauge
        is saturated.
        """
        gauges_v = self._gauges.latest_v(self._samples_per_bias)
        if self._calibration.saturated(gauges_v):
            raise DeviceError(
                f"force sensor {self._calibration.serial}: a gauge is at the end of its range"
                " without load",
                "unload the sensor and check its cable and power; then take the bias again",
            )
        self._bias_v = gauges_v.mean(axis=0)
        return self._bias_v

    def keep_bias(self, before: GaugeForceSensor) -> None:
        """Go on with the bias of the same transducer, connected before: somebody may press it
        now.
        """
        self._bias_v = before._bias_v

    def read_wrench(self) -> Wrench:
        """Return force and torque now. Raises DeviceError, also when no bias was taken."""
        if self._bias_v is None:
            raise DeviceError(
                f"force sensor {self._calibration.serial}: no bias was taken",
                "unload the sensor and take the bias",
            )
        gauges_v = self._gauges.latest_v(self._samples_per_reading)
        fx, fy, fz, tx, ty, tz = (
            float(x) for x in self._calibration.wrench(gauges_v.mean(axis=0), self._bias_v)
        )
        saturated = self._calibration.saturated(gauges_v) or self._calibration.overloaded(
            np.array([fx, fy, fz, tx, ty, tz])
        )
        return Wrench(self._clock(), (fx, fy, fz), (tx, ty, tz), saturated)

    def read(self) -> ForceReading:
        """Return the newest reading, seen from the screen. Raises DeviceError."""
        return self._axes.reading(self.read_wrench())
