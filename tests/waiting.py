"""Waiting for what another thread or process does; the limit is for hangs alone."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

HANG_S = 120.0


def until(condition: Callable[[], Any], said: Callable[[], object] = lambda: "") -> Any:
    """Wait for it; what it gave. `said` is what to show of a wait that hangs."""
    until_s = time.monotonic() + HANG_S
    while not (found := condition()):
        assert time.monotonic() < until_s, said()
        time.sleep(0.01)
    return found


def exists(pid: int) -> bool:
    """Whether a process runs; one that has ended and that nobody has asked for its status does
    not.
    """
    try:
        os.kill(pid, 0)
        return Path(f"/proc/{pid}/stat").read_text().split(")")[1].split()[0] != "Z"
    except (ProcessLookupError, FileNotFoundError):
        return False
