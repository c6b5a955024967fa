"""The daemon on the rig with an analog output: what comes out at the simulated electrode."""

import os
import signal
import time
from contextlib import suppress

import pytest

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
    assert max(v for _, v in history()) <= daemon.basis.settings.config.limits.voltage_v
    assert daemon.status().output_on is True
    off_s = time.monotonic()
    status = daemon.off()
    assert (status.state, status.output_on) == (DaemonState.ARMED, False)
    zero_s = next(t for t, v in history()[::-1] if v == 0.0)
    assert history()[-1][1] == 0.0
    time.sleep(0.05)
    assert [v for t, v in history(max(off_s, zero_s)) if v > 0.0] == []


def test_it_renders_the_voltage_that_render_asks_for(daemon, history):
    lease = daemon.arm(LEASE_S)
    daemon.targets.set(lease.token, 0.66)

    def agrees():
        """The electrode now, and what was asked for within the last 20 ms."""
        at_s = time.monotonic()
        asked = [v for v in daemon.samples(0, 20)["voltage_v"] if v > 20.0]
        seen = history(at_s - 0.02)
        return asked and seen and min(asked) * 0.98 <= seen[-1][1] <= max(asked) * 1.02

    keep_rendering(daemon, lease.token, agrees)


def test_instruments_that_die_are_a_fault_and_come_back_with_their_envelope(daemon, history):
    lease = daemon.arm(LEASE_S)
    daemon.targets.set(lease.token, 0.66)
    keep_rendering(
        daemon, lease.token, lambda: [v for _, v in history(time.monotonic() - 0.1) if v > 10.0]
    )
    os.kill(daemon.pids["instruments"], signal.SIGKILL)
    until(lambda: daemon.status().state is DaemonState.FAULT)
    assert daemon.status().output_on is not True
    reset(daemon)
    began_s = time.monotonic()
    lease = daemon.arm(LEASE_S)
    daemon.targets.set(lease.token, 0.66)
    keep_rendering(daemon, lease.token, lambda: [v for _, v in history(began_s) if v > 10.0])


def test_a_writer_that_dies_is_a_fault_at_zero_and_comes_back(daemon, history):
    lease = daemon.arm(LEASE_S)
    daemon.targets.set(lease.token, 0.66)
    keep_rendering(
        daemon, lease.token, lambda: [v for _, v in history(time.monotonic() - 0.1) if v > 10.0]
    )
    os.kill(daemon.pids["envelope"], signal.SIGKILL)
    until(lambda: daemon.status().state is DaemonState.FAULT)
    assert "envelope" in daemon.status().fault
    until(lambda: history()[-1][1] == 0.0)
    reset(daemon)
    began_s = time.monotonic()
    lease = daemon.arm(LEASE_S)
    daemon.targets.set(lease.token, 0.66)
    keep_rendering(daemon, lease.token, lambda: [v for _, v in history(began_s) if v > 10.0])


def test_a_writer_that_stands_still_takes_the_output_away(daemon, history):
    began_s = time.monotonic()
    lease = daemon.arm(LEASE_S)
    daemon.targets.set(lease.token, 0.66)
    keep_rendering(daemon, lease.token, lambda: [v for _, v in history(began_s) if v > 10.0])
    os.kill(daemon.pids["envelope"], signal.SIGSTOP)
    try:
        until(lambda: history()[-1][1] == 0.0)
        until(lambda: daemon.status().state is DaemonState.FAULT)
    finally:
        with suppress(ProcessLookupError):
            os.kill(daemon.pids["envelope"], signal.SIGCONT)
    reset(daemon)


def test_an_envelope_that_runs_dry_is_counted_flagged_and_told(daemon, history):
    lease = daemon.arm(LEASE_S)
    daemon.targets.set(lease.token, 0.66)
    began_s = time.monotonic()  # the end of an envelope of zeros, under a lifted finger, is no gap
    keep_rendering(daemon, lease.token, lambda: [v for t, v in history(began_s)[-1:] if v > 10.0])
    before, last = daemon.status().underruns, daemon.events(0)[-1].number
    os.kill(daemon.pids["envelope"], signal.SIGSTOP)  # nobody writes meanwhile
    time.sleep(0.1)
    os.kill(daemon.pids["envelope"], signal.SIGCONT)

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
