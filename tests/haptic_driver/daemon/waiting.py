"""Waiting for the daemon under a lease that is kept meanwhile."""

from __future__ import annotations

from tests.waiting import until


def keep_rendering(daemon, token, condition):
    """Renew the lease until the condition holds."""
    return until(lambda: daemon.renew(token) and condition())
