"""The daemon on a rig whose carrier and envelope come from one card: linen at 80 mm/s."""

import time
from dataclasses import replace

import numpy as np
import pytest

from haptic_driver.daemon.daemon import Daemon
from haptic_driver.daemon.messages import DaemonState
from haptic_driver.daemon.set_up import reach_hz
from haptic_driver.fidelity.perception import load_perception
from haptic_driver.fidelity.samples import fidelity_of_samples
from tests.even_strokes import even_strokes, write_slide
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


@pytest.mark.soak
@pytest.mark.timeout(600)
def test_linen_at_80_mm_per_s(settings, tmp_path):
    write_slide(even_strokes(0.080), tmp_path / "slide.csv")
    with Daemon(replace(settings, slide=tmp_path / "slide.csv", amplifier_record=None)) as daemon:
        lease = daemon.arm(60.0)
        daemon.targets.play(lease.token, "linen", nearest=True)
        for _ in range(12):  # the finger becomes known
            time.sleep(0.4)
            daemon.renew(lease.token)
        position, parts = daemon.shared.ring.position, []
        until_s = time.monotonic() + 9.6  # two touches at each end of the slide
        while time.monotonic() < until_s:
            time.sleep(0.4)
            daemon.renew(lease.token)
            taken = daemon.shared.ring.read(position)
            position = taken.position
            parts.append(taken.samples)
        daemon.off()
    found = fidelity_of_samples(np.concatenate(parts), load_perception(), reach_hz(settings.config))
    print(f"linen at 80 mm/s: {found}")
    assert found.share_within_5_percent > 0.5
