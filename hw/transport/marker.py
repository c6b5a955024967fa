"""Finding the place again on a line that cannot be hung up: serial ports carry late answers from
before.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable

from hw.errors import BadReply

# Number -> a question with its line end, and its answer without. Consecutive numbers must give
# different answers.
Marker = Callable[[int], tuple[bytes, bytes]]

_SCPI_ANSWERS_LEAST, _SCPI_ANSWERS_SPREAD = 3, 8


def scpi_marker(number: int) -> tuple[bytes, bytes]:
    """Ask several times in one line whether all is done; nothing changes, and the answer counts the
    questions.

    IEEE 488.2 answers a compound query in one line, joined by semicolons.
    """
    repeats = _SCPI_ANSWERS_LEAST + number % _SCPI_ANSWERS_SPREAD
    return b";".join([b"*OPC?"] * repeats) + b"\n", b";".join([b"1"] * repeats)


class Resynchroniser:
    """Asks questions with answers of their own, and drops everything before those answers.

    An instrument answers in order, so what was owed from before is then behind.
    """

    def __init__(self, marker: Marker, resource: str) -> None:
        self._marker = marker
        self._resource = resource
        self._numbers = itertools.count(1)

    def __call__(
        self, send: Callable[[bytes], None], receive: Callable[[], bytes], max_bytes: int
    ) -> None:
        """Send two questions and read to the end of the second answer.

        The first may be glued to half a command, and its answer to half a line. Raises what `send`
        and `receive` raise, and BadReply after `max_bytes` without the answer.
        """
        first, _ = self._marker(next(self._numbers))
        second, answer = self._marker(next(self._numbers))
        send(first + second)
        wanted = b"\n" + answer + b"\n"
        received, count = b"", 0
        while wanted not in received.replace(b"\r\n", b"\n"):
            data = receive()
            received = received[-2 * len(wanted) :] + data
            count += len(data)
            if count > max_bytes:
                raise BadReply(
                    f"{self._resource} does not answer {second!r} with {answer!r}",
                    "check the marker; reconnect",
                )
