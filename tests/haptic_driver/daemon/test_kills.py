"""Whatever process is killed or stopped, the electrode is at zero within the lease, by the
amplifier's own record.
"""

from signal import SIGKILL, SIGSTOP

import pytest

from tests.haptic_driver.daemon.killing import LEASE_S, SCHEDULING_S
from tests.waiting import exists, until

pytestmark = pytest.mark.realtime

SENT = (("render", SIGKILL), ("watchdog", SIGKILL), ("instruments", SIGKILL), ("render", SIGSTOP))


@pytest.mark.soak
@pytest.mark.timeout(
    1200
)  # five starts; seconds each, minutes where kernels have to be compiled on a busy machine
@pytest.mark.parametrize("rig", ["simulated", "simulated-carrier"])
def test_output_is_zero_within_the_lease_after_each_process_is_killed_or_stopped(
    killable_daemon, rig
):
    daemon = killable_daemon(rig)
    for name, sent in SENT:
        pids = daemon.await_output()
        took_s = daemon.time_to_zero_s(name, sent)
        assert took_s <= LEASE_S or name == "instruments"  # with them the amplifier itself is gone
        assert daemon.await_fault()
        daemon.go_on()

    stopped, pids = pids["render"], daemon.await_output()
    assert pids["render"] != stopped
    assert (
        daemon.report["late_kernels"] == []
    )  # control was silent while it compiled one, and the lease ran out
    assert daemon.time_to_zero_s("control", SIGKILL) <= LEASE_S
    others = [pid for pid in pids.values() if pid != daemon.process.pid]
    until(lambda: not any(map(exists, others)), lambda: "processes outlive control")


@pytest.mark.realtime
@pytest.mark.soak
@pytest.mark.timeout(600)
def test_a_stopped_control_keeps_its_card_and_the_electrode_comes_to_zero(killable_daemon):
    """The card is reserved for a program that is stopped, and the watchdog resets it."""
    daemon = killable_daemon("simulated-carrier")
    daemon.await_output()
    try:
        assert daemon.time_to_zero_s("control", SIGSTOP) <= LEASE_S + SCHEDULING_S
    finally:
        daemon.process.kill()
