"""Waiting for the daemon: until it is ready, and under a lease that is kept meanwhile."""

from __future__ import annotations

import pytest

from tests.waiting import until

LEASE_S = 60.0  # one that a busy machine does not lose


def until_ready(process):
    """Read a daemon's standard error until it serves; when it ends instead, fail with what it said."""
    said = []
    for line in process.stderr:
        said.append(line)
        if "ready at" in line:
            return
    process.stderr.close()
    pytest.fail(f"the daemon ended, status {process.wait()}: {''.join(said)}")


def keep_rendering(daemon, token, condition):
    """Renew the lease until the condition holds."""
    return until(lambda: daemon.renew(token) and condition())
