"""Work that may hang, such as a plug-in's, is waited for so long and no longer."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Iterable

from haptic_driver.processes.started import start_thread

_log = logging.getLogger(__name__)


def join_within(time_s: float, threads: Iterable[threading.Thread]) -> None:
    """Wait until all have ended, or for `time_s` in all. A thread that hangs is reported, and ends
    with the process.
    """
    until_s = time.monotonic() + time_s
    for thread in threads:
        thread.join(max(until_s - time.monotonic(), 0.0))
        if thread.is_alive():
            _log.error("%s hangs and is left alone", thread.name)


def done_within(time_s: float, work: Callable[[], object]) -> None:
    """Do the work in a thread of its own, or here where there is none to be had."""
    try:
        thread = start_thread("bounded", work)
    except RuntimeError:
        work()
        return
    thread.name = getattr(work, "__qualname__", repr(work))
    join_within(time_s, [thread])
