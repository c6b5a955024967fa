"""Whatever process is killed, the electrode is at zero within the lease, by the simulated amplifier's own record."""

from __future__ import annotations

import pytest

from tests.waiting import exists, until

LEASE_S = 0.5


def assert_zero_within_lease(history_after_kill):
    """Zero comes within the lease and stays; no entry at all means that the amplifier itself is gone."""
    on = [t for t, voltage_v in history_after_kill if voltage_v > 0.0]
    assert all(t <= LEASE_S for t in on), history_after_kill[-5:]


@pytest.mark.timeout(1200)  # five starts; seconds each, minutes where kernels have to be compiled on a busy machine
def test_output_is_zero_within_the_lease_after_each_process_is_killed(killable_daemon):
    daemon = killable_daemon()
    for name in ("render", "watchdog", "instruments", "render"):
        pids = daemon.await_output()
        after = daemon.kill(pids[name])
        assert_zero_within_lease(after)
        if name != "instruments":
            assert after[-1][1] == 0.0
        assert daemon.await_fault()
        daemon.go_on()

    pids = daemon.await_output()
    after = daemon.kill(pids["control"])
    assert_zero_within_lease(after)
    assert after[-1][1] == 0.0
    others = [pid for pid in pids.values() if pid != daemon.process.pid]
    until(lambda: not any(map(exists, others)), lambda: "processes outlive control")
