"""Rendering without a pause: it keeps its ticks and its memory.

`HAPTIC_SOAK_RENDER_S`: how long (600). `HAPTIC_SOAK_RIG`: the name of a simulated rig (simulated),
simulated-envelope for an analog envelope.
"""

from __future__ import annotations

import os
import time
from pathlib import Path

import pytest

from haptic_driver.daemon.daemon import Daemon
from haptic_driver.daemon.messages import DaemonState
from haptic_driver.daemon.set_up import daemon_settings
from haptic_driver.processes.real_time import take_precedence

RENDER_S = float(os.environ.get("HAPTIC_SOAK_RENDER_S", "600"))
RIG = os.environ.get("HAPTIC_SOAK_RIG", "simulated")


@pytest.mark.soak
@pytest.mark.timeout(RENDER_S + 600)
def test_rendering_keeps_its_ticks_and_its_memory():
    take_precedence()  # as `haptic daemon run` does
    with Daemon(daemon_settings(RIG, "reference")) as daemon:
        lease = daemon.arm(60.0)  # a busy machine may read a texture for seconds
        daemon.targets.play(lease.token, "grating")
        began_s, position = time.monotonic(), daemon.shared.ring.position
        first_tick = daemon.status().ticks
        memory = None
        seen = lost = 0
        while (passed_s := time.monotonic() - began_s) < RENDER_S:
            daemon.renew(lease.token)
            taken = daemon.shared.ring.read(position)
            position, seen, lost = taken.position, seen + len(taken.samples), lost + taken.lost
            assert daemon.status().state is DaemonState.RENDERING
            if memory is None and passed_s > min(60.0, 0.1 * RENDER_S):
                memory = _resident_bytes(daemon)
            time.sleep(0.1)
        status = daemon.status()
        ticks = status.ticks - first_tick
        assert lost == 0
        assert ticks == pytest.approx(1000.0 * RENDER_S, rel=0.01)
        assert seen >= ticks - status.overruns - 1000
        assert memory is not None
        for name, resident in _resident_bytes(daemon).items():
            assert resident < 1.2 * memory[name] + 20e6, name
        daemon.off()
    print(f"{ticks} ticks, {status.overruns} missed, flags {status.flags}")


def _resident_bytes(daemon: Daemon) -> dict[str, int]:
    pages = {
        name: int(Path(f"/proc/{pid}/statm").read_text().split()[1])
        for name, pid in daemon.pids.items()
    }
    return {name: count * os.sysconf("SC_PAGE_SIZE") for name, count in pages.items()}
