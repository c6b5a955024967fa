"""Waiting for the daemon: until it is ready, and under a lease that is kept, or lost, meanwhile."""

from __future__ import annotations

from contextlib import suppress

import pytest

from haptic_driver.daemon.messages import DaemonState, RefusedError
from haptic_driver.errors import HapticError
from tests.waiting import until

LEASE_S = 60.0  # one that a busy machine does not lose
STOOD_STILL = (
    "not beaten in time",
    "render has said nothing",
    "this machine was late meanwhile",
)  # in faults of a machine that did so for as long as a watchdog or a load loop waits


def until_ready(process):
    """Read a daemon's standard error until it serves; when it ends instead, fail with what it
    said.
    """
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


def reset(daemon):
    """Acknowledge a fault, as soon as its cause is gone."""

    def is_idle():
        with suppress(HapticError):
            return daemon.status().state is DaemonState.IDLE or daemon.reset()

    until(is_idle, daemon.status)


def let_go(daemon):
    """The status once a lease has ended: in idle, or in the fault of a machine that stood still,
    which is off too.
    """
    until(lambda: daemon.status().state in (DaemonState.IDLE, DaemonState.FAULT), daemon.status)
    status = daemon.status()
    assert status.state is DaemonState.IDLE or any(
        reason in status.fault for reason in STOOD_STILL
    ), status
    return status


def lose_the_client(daemon, renders):
    """Render until `renders` holds and renew no more; the lease, once that has ended in idle.

    Begun again where a machine that stood still ended it: off by another's hand.
    """
    while True:
        lease = daemon.arm(1.0)
        has_rendered = False
        with suppress(RefusedError):  # that machine may have lost the lease before
            daemon.targets.set(lease.token, 0.65)
            has_rendered = keep_rendering(daemon, lease.token, renders)
        if let_go(daemon).state is DaemonState.FAULT:
            reset(daemon)
        elif has_rendered:
            return lease
