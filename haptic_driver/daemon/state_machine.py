"""Where the daemon is, and what may happen there: states, the lease, faults. No clock, no devices,
no threads.
"""

from __future__ import annotations

import secrets
from math import inf

from haptic_driver.daemon.messages import SOMEBODY, DaemonState, Lease, RefusedError

DISCONNECTED, IDLE, ARMED, RENDERING, FAULT = DaemonState
RESET_HINT = "remove the cause, then reset"


class StateMachine:
    """The moves of `DaemonState`; RefusedError for one that is not allowed, which changes nothing.

    Arming gives a lease to whoever asked; only its holder may renew it or ask for output. A fault
    ends the lease and is left by `reset` alone. `arming` counts armings.
    """

    def __init__(self) -> None:
        self.state = DISCONNECTED
        self.fault_reason: str | None = None
        self.arming = 0
        self.lease_until_s = -inf
        self.holder: str | None = None
        self._lease: Lease | None = None
        self._ran_out: Lease | None = None

    @property
    def armed(self) -> bool:
        """Whether there is a lease."""
        return self.state in (ARMED, RENDERING)

    def connected(self) -> None:
        """Everything that the output needs is there."""
        if self.state is DISCONNECTED:
            self.state = IDLE

    def arm(self, now_s: float, lease_s: float, holder: str = SOMEBODY) -> Lease:
        """Idle -> armed; others see `holder` as who armed."""
        if self.armed:
            raise RefusedError(
                "already_armed",
                f"{self.holder} holds the lease",
                "wait for it to end, or disarm first",
            )
        if self.state is FAULT:
            raise RefusedError("fault", self._fault_said, RESET_HINT)
        if self.state is not IDLE:
            raise RefusedError(
                "not_connected", "the rig is not connected yet", "wait until the state is idle"
            )
        self._lease, self._ran_out = Lease(token=secrets.token_urlsafe(16), lease_s=lease_s), None
        self.state, self.holder = ARMED, holder
        self.arming += 1
        self.lease_until_s = now_s + lease_s
        return self._lease

    def renew(self, token: str, now_s: float) -> Lease:
        """The lease counts from now again."""
        lease = self._held(token, now_s)
        self.lease_until_s = now_s + lease.lease_s
        return lease

    def is_held_by(self, token: str) -> bool:
        """Whether there is a lease and it has this token."""
        return _is_of(token, self._lease)

    def render(self, token: str, now_s: float) -> None:
        """Armed or rendering -> rendering."""
        self._held(token, now_s)
        self.state = RENDERING

    def off(self) -> None:
        """Rendering -> armed; elsewhere nothing changes."""
        if self.state is RENDERING:
            self.state = ARMED

    def disarm(self) -> None:
        """Armed or rendering -> idle."""
        if self.armed:
            self.state = IDLE
        self._lease, self.holder, self.lease_until_s = None, None, -inf

    def run_out(self, arming: int) -> None:
        """As disarm, unless somebody has armed since that arming; who held the lease is told."""
        if arming == self.arming:
            ended = self._lease
            self.disarm()
            self._ran_out = ended

    def fault(self, reason: str) -> bool:
        """Any state -> fault; True when that is news. The first reason is kept."""
        news = self.state is not FAULT
        self.disarm()
        self.state = FAULT
        self.fault_reason = self.fault_reason if self.fault_reason is not None else reason
        return news

    def reset(self) -> None:
        if self.state is FAULT:
            self.state, self.fault_reason = IDLE, None

    @property
    def _fault_said(self) -> str:
        return f"the daemon is in fault: {self.fault_reason}"

    def _held(self, token: str, now_s: float) -> Lease:
        if self.state is FAULT:
            raise RefusedError("not_armed", f"nobody holds a lease; {self._fault_said}", RESET_HINT)
        if self._lease is None and self._ran_out is not None and _is_of(token, self._ran_out):
            raise _expired(self._ran_out)
        if self._lease is None:
            raise RefusedError(
                "not_armed", f"nobody holds a lease; the daemon is {self.state}", "arm first"
            )
        if not self.is_held_by(token):
            raise RefusedError(
                "not_yours",
                f"{self.holder} holds the lease{'' if token else ', and no token of it was sent'}",
                "wait for it to end, or disarm and arm"
                if token
                else "send what arm gave, over HTTP as the header X-Haptic-Lease",
            )
        if now_s > self.lease_until_s:
            raise _expired(self._lease)
        return self._lease


def _is_of(token: str, lease: Lease | None) -> bool:
    return lease is not None and secrets.compare_digest(token.encode(), lease.token.encode())


def _expired(lease: Lease) -> RefusedError:
    return RefusedError(
        "lease_expired",
        f"the lease of {lease.lease_s:g} s has run out: nothing renewed it in time",
        "arm again, and renew it in time; browsers let hidden pages sleep",
    )
