"""What an event line can do: up to eight wires that carry a code as long as it is put there. And
what a line in can do: one wire that somebody else makes high.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

HIGHEST_CODE = 255


class EventLine(Protocol):
    """Eight wires, or one that is high for every code but 0.

    `open` and `put` raise DeviceError where the line is dead.
    """

    resource: str

    def open(self) -> None:
        """Take the line, with all wires low; may be called again after `close`."""

    def put(self, code: int, /) -> None:
        """Put out a code, 0 to 255, until the next."""

    def close(self) -> None:
        """All wires low, if they still can be; let go. Never raises."""


class LineIn(Protocol):
    """One wire that is looked at again and again. `open` and `levels` raise DeviceError where the
    line is dead.
    """

    resource: str

    def open(self) -> None:
        """Take the line; may be called again after `close`."""

    def levels(self) -> Sequence[bool]:
        """The level now. Of a line that says when it changes: every level since the last call,
        oldest first, for which it may wait a few milliseconds.
        """

    def close(self) -> None:
        """Let go. Never raises."""
