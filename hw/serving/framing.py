"""Cuts a stream of bytes into messages, as an instrument without message bounds on its link
does.
"""

from __future__ import annotations

from collections.abc import Iterator

MAX_MESSAGE_BYTES = 1 << 20


class MessageTooLong(ConnectionError):  # noqa: N818 - on this side a reason to hang up
    """More bytes than any message has, without a line end."""


class MessageFramer:
    r"""Collects bytes and hands out messages with their `\n`."""

    def __init__(self) -> None:
        self._pending = b""

    def feed(self, data: bytes) -> Iterator[bytes]:
        """Add `data` and yield the messages that are complete; raises MessageTooLong."""
        *messages, self._pending = (self._pending + data).split(b"\n")
        yield from (message + b"\n" for message in messages)
        if len(self._pending) > MAX_MESSAGE_BYTES:
            raise MessageTooLong(f"{len(self._pending)} bytes without a line end")
