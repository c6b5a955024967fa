"""Whatever process is killed or stopped, the electrode comes to zero by the amplifier's own record, and it goes on.

How soon is counted over hundreds of kills beside busy loops: `make kills`.
"""

from __future__ import annotations

import os
from signal import SIGKILL, SIGSTOP

import pytest

from tests.haptic_driver.daemon.electrode import history
from tests.waiting import exists, until

SENT = (("render", SIGKILL), ("watchdog", SIGKILL), ("instruments", SIGKILL), ("render", SIGSTOP))


@pytest.mark.timeout(1200)  # five starts; seconds each, minutes where kernels have to be compiled on a busy machine
@pytest.mark.soak
def test_output_goes_to_zero_after_each_process_is_killed_or_stopped(killable_daemon):
    daemon = killable_daemon()
    for name, sent in SENT:
        pids = daemon.await_output()
        os.kill(pids[name], sent)
        assert daemon.await_fault()
        if name != "instruments":  # with them the amplifier itself is gone
            until(lambda: history(daemon.record)[-1][1] == 0.0)
        daemon.forget_output()
        daemon.go_on()

    stopped, pids = pids["render"], daemon.await_output()
    assert pids["render"] != stopped
    assert daemon.report["late_kernels"] == []  # control was silent while it compiled one, and the lease ran out
    os.kill(pids["control"], SIGKILL)
    until(lambda: history(daemon.record)[-1][1] == 0.0)
    others = [pid for pid in pids.values() if pid != daemon.process.pid]
    until(lambda: not any(map(exists, others)), lambda: "processes outlive control")
