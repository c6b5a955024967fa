"""The daemon on the rig with an analog output: what comes out at the simulated electrode."""

import os
import time
from contextlib import suppress
from signal import SIGCONT, SIGKILL, SIGSTOP

import pytest

from haptic_driver.daemon import supervision
from haptic_driver.daemon.messages import DaemonState
from tests.haptic_driver.daemon.waiting import LEASE_S, keep_rendering, reset
from tests.waiting import until

pytestmark = pytest.mark.realtime

DAEMON_RIG = "simulated-envelope"


def test_the_electrode_follows_every_tick_and_not_only_every_set_point(daemon, history):
    assert daemon.status().actuator == "analog envelope"
    lease = daemon.arm(LEASE_S)
    daemon.targets.play(lease.token, "grating")
    assert daemon.status().state is DaemonState.RENDERING
    interval_s = daemon.basis.settings.config.output.setpoint_interval_s

    def moves():
        """More different voltages in a quarter of a second than set points could make in all of
        it.
        """
        seen = {v for _, v in history(time.monotonic() - 0.25) if v > 10.0}
        return len(seen) > 0.25 / interval_s

    keep_rendering(daemon, lease.token, moves)
    daemon.targets.set(lease.token, 0.66)

    def agrees():
        """The electrode now, and what was asked for within the last 20 ms."""
        at_s = time.monotonic()
        asked = [v for v in daemon.samples(0, 20)["voltage_v"] if v > 20.0]
        seen = history(at_s - 0.02)
        return asked and seen and min(asked) * 0.98 <= seen[-1][1] <= max(asked) * 1.02

    keep_rendering(daemon, lease.token, agrees)
    assert max(v for _, v in history()) <= daemon.basis.settings.config.limits.voltage_v
    assert daemon.status().output_on is True
    off_s = time.monotonic()
    status = daemon.off()
    assert (status.state, status.output_on) == (DaemonState.ARMED, False)
    zero_s = next(t for t, v in history()[::-1] if v == 0.0)
    assert history()[-1][1] == 0.0
    time.sleep(0.05)
    assert [v for t, v in history(max(off_s, zero_s)) if v > 0.0] == []


def rendered(daemon, history):
    """The lease, once there is voltage anew."""
    began_s, lease = time.monotonic(), daemon.arm(LEASE_S)
    daemon.targets.set(lease.token, 0.66)
    # the end of an envelope of zeros, under a lifted finger, is no gap
    keep_rendering(daemon, lease.token, lambda: [v for _, v in history(began_s)[-1:] if v > 10.0])
    return lease


@pytest.mark.parametrize(
    ("which", "sent"), [("instruments", SIGKILL), ("envelope", SIGKILL), ("envelope", SIGSTOP)]
)
def test_a_process_that_dies_or_stands_still_is_a_fault_at_zero_and_comes_back(
    daemon, history, monkeypatch, which, sent
):
    monkeypatch.setattr(supervision, "LOST_S", 0.5)
    rendered(daemon, history)
    pid = daemon.pids[which]
    os.kill(pid, sent)
    until(lambda: daemon.status().state is DaemonState.FAULT)
    assert which in daemon.status().fault or which == "instruments"
    assert daemon.status().output_on is not True
    if which == "envelope":
        until(lambda: history()[-1][1] == 0.0)
    with suppress(ProcessLookupError):
        os.kill(pid, SIGCONT)
    reset(daemon)
    rendered(daemon, history)


def test_an_envelope_that_runs_dry_is_counted_flagged_and_told(daemon, history):
    lease = rendered(daemon, history)
    before, last = daemon.status().underruns, daemon.events(0)[-1].number
    os.kill(daemon.pids["envelope"], SIGSTOP)  # nobody writes meanwhile
    time.sleep(0.1)
    os.kill(daemon.pids["envelope"], SIGCONT)

    def told():
        counts = [
            event.data["underruns"] for event in daemon.events(last) if event.message == "underrun"
        ]
        return [count for count in counts if count > before]  # one of earlier gaps may be told late

    keep_rendering(daemon, lease.token, told)
    assert daemon.status().underruns >= told()[0]
    assert "underrun" in daemon.status().flags
    daemon.disarm()
    daemon.arm(1.0)
    assert daemon.status().flags == []
