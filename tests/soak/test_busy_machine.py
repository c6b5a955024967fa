"""A starved machine: rendering goes on, worse, and says so; nothing trips.

`HAPTIC_SOAK_BUSY_S`: how long (600). `HAPTIC_SOAK_LOAD`: busy processes of normal niceness (16). A
client asks for the status and the ticks 10 times a second meanwhile.
"""

import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from haptic_driver.client import HapticClient
from haptic_driver.daemon.messages import DaemonState
from haptic_driver.daemon.timing import EDGES_S, IN_TIME_S
from tests.haptic_driver.daemon.waiting import until_ready
from tests.waiting import HANG_S

BUSY_S = float(os.environ.get("HAPTIC_SOAK_BUSY_S", "600"))
LOAD = int(os.environ.get("HAPTIC_SOAK_LOAD", "16"))
LEASE_S = 5.0


@pytest.fixture
def socket(tmp_path):
    """A daemon as `haptic daemon run` starts it."""
    path = tmp_path / "run" / "daemon.sock"
    command = [Path(sys.executable).with_name("haptic"), "daemon", "run", "--socket", str(path)]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as process:
        until_ready(process)
        yield path
        process.terminate()
        process.stderr.read()
        process.wait(HANG_S)


@pytest.mark.soak
@pytest.mark.timeout(BUSY_S + 600)
def test_rendering_on_a_busy_machine_is_no_fault(socket, busy):
    with HapticClient(socket) as client, client.armed(LEASE_S) as session:
        session.play("grating")
        busy(LOAD)
        first = newest = client.status().ticks
        counts, in_time, seen = np.zeros(len(EDGES_S), int), 0, 0
        until_s = time.monotonic() + BUSY_S
        while time.monotonic() < until_s:
            ticks = client.samples(newest, 2000)
            newest = int(ticks["tick"][-1]) if ticks.size else newest
            lateness_s = np.maximum(ticks["lateness_s"], 0.0)
            counts += np.histogram(lateness_s, [*EDGES_S, np.inf])[0]
            in_time, seen = in_time + np.count_nonzero(lateness_s <= IN_TIME_S), seen + ticks.size
            status = client.status()
            assert status.state is DaemonState.RENDERING, (status.fault, client.events()[-5:])
            time.sleep(0.1)
        told = [
            event.message
            for event in client.events()
            if event.kind in ("timing", "fault", "output", "trip")
        ]
    due, load = newest - first, os.getloadavg()[0]
    print(
        f"{due} instants, {due - seen} without a tick, {in_time / due:.2%} within 2 ms, load"
        f" {load:.0f}"
    )
    print(dict(zip(EDGES_S, counts.tolist(), strict=True)))
    print(len(told), "warnings; the last:", told[-1:], flush=True)
    assert in_time / due > 0.95
