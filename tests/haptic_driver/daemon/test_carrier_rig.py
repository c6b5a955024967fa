"""The daemon on a rig whose carrier and envelope come from one card: linen at 80 mm/s."""

import time

import pytest

from haptic_driver.daemon.messages import DaemonState
from tests.haptic_driver.daemon.waiting import LEASE_S, keep_rendering

pytestmark = pytest.mark.realtime

DAEMON_RIG = "simulated-carrier"


def test_it_renders_the_voltage_that_render_asks_for(daemon, history):
    assert daemon.status().actuator == "carrier and envelope as samples"
    lease = daemon.arm(LEASE_S)
    daemon.targets.set(lease.token, 0.66)

    def agrees():
        """The electrode now, and what was asked for within the last 60 ms."""
        at_s = time.monotonic()
        asked = [v for v in daemon.samples(0, 60)["voltage_v"] if v > 20.0]
        seen = [v for _, v in history(at_s - 0.02)]
        return asked and seen and min(asked) * 0.98 <= seen[-1] <= max(asked) * 1.02

    keep_rendering(daemon, lease.token, agrees)
    limit_v = daemon.basis.settings.config.limits.voltage_v
    assert max(v for _, v in history()) <= limit_v * 1.001  # four digits of the record
    status = daemon.off()
    assert (status.state, status.output_on) == (DaemonState.ARMED, False)
    assert history()[-1][1] == 0.0
