"""An event while a rig was rendering, as sent to clients and kept in a recording."""

from __future__ import annotations

from typing import Any

from pydantic import Field

from haptic_driver.config import Checked


class Event(Checked):
    """Something that happened; `number` counts up without gaps."""

    number: int
    time_s: float
    # state | flag | target | texture | model | lease | trip | fault | marker | drift | timing |
    # recording | instruments...
    kind: str
    message: str
    data: dict[str, Any] = Field({})
