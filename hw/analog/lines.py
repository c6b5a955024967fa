"""What single lines between devices can do; drivers are written against these, cards and boxes
supply them.

Every method raises DeviceError when the line is dead, and returns or raises within the line's own
timeout.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from hw.analog.output import Array
from hw.setting import Setting


class DigitalInput(Protocol):
    """One digital line that can be read."""

    def read(self) -> bool:
        """Return the level that is on the line."""


class DigitalOutput(DigitalInput, Protocol):
    """One digital line that can be set; `read` returns the level on the line, not the level last
    asked for.
    """

    def write(self, value: bool, /) -> None:
        """Set the line."""


class AnalogInput(Protocol):
    """One analog input."""

    def read_v(self) -> float:
        """Return the voltage at the input, V; of an alternating voltage its peak."""


class SampledInputs(Protocol):
    """Channels that are sampled all the time, at the rate and with the lags that the device got."""

    @property
    def sample_rate_hz(self) -> float:
        """Samples of each channel per second."""

    @property
    def buffer_s(self) -> float:
        """How far back samples are kept."""

    @property
    def lags_s(self) -> Sequence[float]:
        """How much later each channel is sampled; raises DeviceError."""

    def latest_v(self, count: int) -> Array:
        """Return the newest `count` samples of all channels (count, channels), V; raises
        DeviceError.
        """


class AnalogInputs(Protocol):
    """The inputs of one card or several."""

    def open(self) -> None:
        """Start sampling; does nothing when open."""

    def close(self) -> None:
        """Stop sampling; never fails."""

    def held(self) -> list[Setting]:
        """What was asked of the card and what it got."""

    def latest_v(self, count: int) -> Array:
        """The newest samples of the only card. ValueError where there are several."""

    def columns(self, channels: Sequence[str], conversion_interval_s: float = 0.0) -> SampledInputs:
        """Channels of one card, by name; ValueError for those of several.

        `conversion_interval_s`: from one channel to the next, where the card does not say it.
        """


class Heartbeat(Protocol):
    """Something apart that switches the output off when it is no longer beaten."""

    def beat(self) -> None:
        """Say that the output is still wanted; raises DeviceError once that can no longer be
        had.
        """

    def rest(self) -> None:
        """Say that the output is known to be off, so that beats may stop; may be said again and
        again. Never raises.
        """

    def times_off(self) -> int:
        """How often it has switched off by itself, if known. Never waits, never raises."""
