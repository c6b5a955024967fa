"""What is served: an instrument as bytes in, bytes out."""

from __future__ import annotations

from typing import Protocol


class Responder(Protocol):
    """An instrument as bytes in, bytes out."""

    def handle(self, data: bytes) -> bytes:
        """Carry out complete messages and return their answers; raise ConnectionError to hang
        up.
        """


class Disconnect(ConnectionError):  # noqa: N818 - an event, not an error, on this side
    """Raised by a simulated instrument to hang up after `sent`."""

    def __init__(self, sent: bytes) -> None:
        super().__init__("simulated disconnect")
        self.sent = sent
