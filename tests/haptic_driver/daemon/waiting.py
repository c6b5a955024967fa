"""Waiting for what another thread or process does; the limit is for hangs alone."""

from __future__ import annotations

import time

HANG_S = 120.0


def until(condition):
    """Wait for it; what it gave."""
    until_s = time.monotonic() + HANG_S
    while not (found := condition()):
        assert time.monotonic() < until_s
        time.sleep(0.01)
    return found


def keep_rendering(daemon, token, condition):
    """Renew the lease until the condition holds."""
    return until(lambda: daemon.renew(token) and condition())
