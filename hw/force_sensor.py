"""Force on the touch screen, from whatever sensor the rig has."""

from __future__ import annotations

from typing import NamedTuple, Protocol


class ForceReading(NamedTuple):
    """One reading: time on the sensor's clock, force pressing on the screen (> 0), force along the sliding direction.

    `saturated` is True when a channel was at the end of its range and the numbers are not to be trusted.
    """

    time_s: float
    normal_force_n: float
    lateral_force_n: float
    saturated: bool


class ForceSensor(Protocol):
    """A source of force readings."""

    def read(self) -> ForceReading:
        """Return the newest reading. Raises DeviceError."""
