"""A thread that watches over a rig whose caller may stall."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable
from types import TracebackType
from typing import Self

from haptic_driver.errors import HapticError
from haptic_driver.rig import Rig

_log = logging.getLogger(__name__)


class RigGuard:
    """Calls `rig.watch` every `period_s`; use as `with RigGuard(rig): ...`.

    The rig must be commanded on the same `clock`. What the rig raises here it has already switched off for, and the
    caller meets it at its next command; here it is logged. Not for a process that renders: give it one of its own, and
    a watchdog process (`hw.watchdog`) for when this process dies.
    """

    def __init__(self, rig: Rig, period_s: float = 0.05, clock: Callable[[], float] = time.monotonic) -> None:
        self._rig = rig
        self._period_s = period_s
        self._clock = clock
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._run, name="rig guard", daemon=True)

    def __enter__(self) -> Self:
        """Begin to watch."""
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """End; returns when the thread has."""
        self._ending.set()
        self._thread.join()

    def _run(self) -> None:
        while not self._ending.wait(self._period_s):
            try:
                self._rig.watch(self._clock())
            except HapticError as error:
                _log.error("%s: %s", error.code, error.message)
