"""A log that one kind of trouble cannot fill."""

from __future__ import annotations

import logging
import re
import time
from collections.abc import Callable

from haptic_driver.errors import shown

PERIOD_S = 1.0
KINDS_KEPT = 1000

_DIGITS = re.compile(r"\d+")


class Printable(logging.Formatter):
    """A line as it is shown: what it names moves no cursor. A traceback keeps its lines."""

    def format(self, record: logging.LogRecord) -> str:
        return shown(super().format(record), lines=record.exc_info is not None)


class OncePerSecond(logging.Filter):
    """Lets a message pass once a second; the next one says how many were left out. Numbers in it
    make no difference.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        super().__init__()
        self._clock = clock
        self._told: dict[
            tuple[str, str], tuple[float, int]
        ] = {}  # since when, and how many were left out

    def filter(self, record: logging.LogRecord) -> bool:
        kind, now_s = (record.name, _DIGITS.sub("#", record.getMessage())), self._clock()
        told_s, left_out = self._told.pop(kind, (-PERIOD_S, 0))
        passes = now_s - told_s >= PERIOD_S
        self._told[kind] = (now_s, 0) if passes else (told_s, left_out + 1)
        if len(self._told) > KINDS_KEPT:
            self._told.pop(next(iter(self._told)))
        if passes and left_out:
            record.msg, record.args = (
                f"{record.getMessage()} ({left_out} more like this were left out)",
                None,
            )
        return passes
