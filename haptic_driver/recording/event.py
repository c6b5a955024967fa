"""Something that happened while a rig was rendering, as told to clients and kept in a recording."""

from __future__ import annotations

from typing import Any

from pydantic import BaseModel, ConfigDict


class Event(BaseModel):
    """Something that happened; `number` counts up without gaps."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    number: int
    time_s: float
    kind: str  # state | flag | target | texture | model | lease | trip | fault | marker | drift | recording | outlet
    message: str
    data: dict[str, Any] = {}
