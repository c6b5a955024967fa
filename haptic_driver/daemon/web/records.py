"""What the API says beyond `records`: errors, lists, maps, and the decimated state that its WebSocket sends.

Without numpy, which `haptic status` does not wait for; `frames` makes them from samples.
"""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, RootModel

from haptic_driver.daemon.messages import Record, Status
from haptic_driver.errors import HapticError
from haptic_driver.recording.event import Event

LEASE_HEADER = "X-Haptic-Lease"

Column = list[float | int | None]


class ErrorContent(Record):
    """The three things that every error says."""

    code: str
    message: str
    hint: str


class ErrorReport(Record):
    """Body of every response with a status of 400 and above."""

    error: ErrorContent

    @classmethod
    def of(cls, error: HapticError) -> ErrorReport:
        """The report of one error."""
        return cls(error=ErrorContent(code=error.code, message=error.message, hint=error.hint))


class RecordingRequest(Record):
    """`haptic record FILE`; null stops."""

    path: Annotated[str, Field(min_length=1, max_length=1000, pattern=r"^[^\x00-\x1f]+$")] | None


class TextureNames(Record):
    """What `GET /textures` answers."""

    textures: list[str]


class Events(Record):
    """What `GET /events` answers."""

    events: list[Event]


class SurfaceMap(Record):
    """Friction over frequency and voltage, `cof[frequency][voltage]`, at the usual load."""

    frequency_hz: list[float]
    voltage_v: list[float]
    cof: list[list[float | None]]


class TextureMap(Record):
    """Friction that the present texture asks for, `cof[y][x]`; null where it asks for nothing."""

    x_m: list[float]
    y_m: list[float]
    cof: list[list[float | None]]


class SampleColumns(RootModel[dict[str, Column]]):
    """One list per field of `SAMPLE`, oldest first; null for what is no number."""


class TickSummary(Record):
    """The ticks since the frame before; None where there were none."""

    count: int
    lateness_median_s: float | None
    lateness_max_s: float | None
    compute_median_s: float | None
    compute_max_s: float | None
    lateness_edges_s: list[float]
    lateness_counts: list[int]


class StateFrame(Record):
    """One message of the WebSocket `/state`: the status, the newest sample, and how the ticks went."""

    status: Status
    newest: dict[str, float | int | None] | None
    ticks: TickSummary
