"""Cuts a stream of bytes into messages, as an instrument without message bounds on its link does."""

from __future__ import annotations

import re
from collections.abc import Iterator

MAX_MESSAGE_BYTES = 1 << 22

# A line end; a string, which may hold a #; the start of an IEEE 488.2 definite-length block. The last two may be cut
# short by the end of what has come.
_TOKEN = re.compile(rb'\n|"[^"\n]*(?:["\n]|\Z)|#(?:[1-9]|\Z)')


class MessageTooLong(ConnectionError):  # noqa: N818 - on this side a reason to hang up
    """More bytes than any message has, without a line end."""


class MessageFramer:
    r"""Collects bytes and hands out messages with their `\n`; a `\n` inside a binary block does not end one."""

    def __init__(self) -> None:
        self._pending = bytearray()
        self._searched = 0

    def feed(self, data: bytes) -> Iterator[bytes]:
        """Add `data` and yield the messages that are complete; raises MessageTooLong."""
        self._pending += data
        while (end := self._message_end()) is not None:
            message = bytes(self._pending[:end])
            del self._pending[:end]
            self._searched = 0
            yield message
        if len(self._pending) > MAX_MESSAGE_BYTES:
            raise MessageTooLong(f"{len(self._pending)} bytes without a line end")

    def _message_end(self) -> int | None:
        while (token := _TOKEN.search(self._pending, self._searched)) is not None:
            if token[0].endswith(b"\n"):
                return token.end()
            after = self._after_block(token.end()) if token[0].startswith(b"#") else self._after_string(token)
            if after is None:
                self._searched = token.start()
                return None
            self._searched = after
        self._searched = len(self._pending)
        return None

    @staticmethod
    def _after_string(token: re.Match[bytes]) -> int | None:
        """Where a string ends; None while its end is not here."""
        return token.end() if len(token[0]) > 1 and token[0].endswith(b'"') else None

    def _after_block(self, digits_at: int) -> int | None:
        """Where the block ends whose length starts at `digits_at`; None while not all of it is here."""
        count = self._pending[digits_at - 1 : digits_at]
        if not count.isdigit():
            return None
        data_at = digits_at + int(count)
        digits = self._pending[digits_at:data_at]
        if digits and not digits.isdigit():
            return digits_at  # no block after all
        if len(self._pending) < data_at:
            return None
        end = data_at + int(digits)
        return end if len(self._pending) >= end else None
