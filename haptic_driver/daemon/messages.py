"""What the daemon and its clients tell one another: states, status, events, requests."""

from __future__ import annotations

from collections.abc import Sequence
from enum import StrEnum
from typing import TYPE_CHECKING, Annotated, Any, Protocol

from pydantic import BaseModel, ConfigDict, Field, FiniteFloat

from haptic_driver.errors import HapticError
from haptic_driver.recording.event import Event

if TYPE_CHECKING:  # `haptic status` does not wait for numpy
    import numpy as np
    from numpy.typing import NDArray

HIGHEST_COF = 10.0  # that anybody may ask for


class DaemonState(StrEnum):
    """Where the daemon is; output is possible in `rendering` alone."""

    DISCONNECTED = "disconnected"
    IDLE = "idle"
    ARMED = "armed"
    RENDERING = "rendering"
    FAULT = "fault"


class Record(BaseModel):
    """Base of everything that crosses the API; unknown keys are errors."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class Status(Record):
    """`haptic status`; `output_on` is None where nobody knows."""

    state: DaemonState
    simulated: bool
    rig: str
    model: str
    texture: str | None
    target_cof: float | None
    measured_cof: float | None
    frequency_hz: float | None
    voltage_v: float | None
    output_on: bool | None
    ticks: int
    overruns: int
    underruns: int  # gaps, at zero, of an analog envelope
    flags: list[str]
    fault: str | None
    lease_left_s: float | None
    actuator: str  # "setpoints over SCPI" or "analog envelope"
    real_time: bool
    latency_budget_s: dict[str, float]
    surface_hash: str
    recording: str | None


class Lease(Record):
    """What `arm` gives: to be renewed within `lease_s`, or the output ramps to zero."""

    token: str
    lease_s: float


class Target(Record):
    """`haptic set MU`."""

    cof: Annotated[FiniteFloat, Field(gt=0.0, le=HIGHEST_COF)]


class TextureChoice(Record):
    """`haptic texture play T`."""

    name: Annotated[str, Field(min_length=1, max_length=200)]


class ModelChoice(Record):
    """`haptic use MODEL`."""

    name: Annotated[str, Field(min_length=1, max_length=1000)]


class ArmRequest(Record):
    """`haptic arm`."""

    lease_s: Annotated[FiniteFloat, Field(ge=0.1, le=60.0)] = 0.5


class RefusedError(HapticError):
    """The daemon is not in a state to do this; nothing was changed."""


class Control(Protocol):
    """What the API needs of the daemon; every call is thread-safe, returns at once and raises HapticError."""

    def status(self) -> Status:
        """The present state."""

    def arm(self, lease_s: float) -> Lease:
        """Idle -> armed; `RefusedError` in any other state or with the reason why the rig is not ready."""

    def renew(self, token: str) -> Lease:
        """Keep the lease alive; `RefusedError` for another's token or an expired lease."""

    def set_target(self, token: str, cof: float) -> Status:
        """Ask for one friction everywhere; armed -> rendering."""

    def play(self, token: str, texture: str) -> Status:
        """Ask for a texture; armed -> rendering."""

    def off(self) -> Status:
        """Output to zero at once, from anyone, in any state; rendering -> armed."""

    def disarm(self) -> Status:
        """Off, and the lease is gone; -> idle."""

    def reset(self) -> Status:
        """Acknowledge a fault or trip whose cause is gone; fault -> idle."""

    def use_model(self, name: str) -> Status:
        """Render by another model, such as one of this finger; while idle, and not while recording."""

    def record(self, path: str | None) -> Status:
        """Start recording into a file, or stop with None."""

    def textures(self) -> list[str]:
        """Names that `play` knows."""

    def samples(self, since_tick: int, most: int) -> NDArray[np.void]:
        """Records of dtype SAMPLE after `since_tick`, the newest `most` of them."""

    def events(self, since: int) -> Sequence[Event]:
        """Events with a number above `since`, as far back as they are kept."""

    def surface_map(self) -> dict[str, Any]:
        """`frequency_hz` [m], `voltage_v` [n], `cof` [m][n] at the usual load, for the dashboard's picture."""

    def texture_map(self) -> dict[str, Any]:
        """`x_m`, `y_m`, `cof` [ny][nx] of the texture that plays, on the screen, coarse enough to draw."""
