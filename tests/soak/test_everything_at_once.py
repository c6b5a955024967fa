"""An app's commands, a held load and a busy machine together: no fault, and nothing trips.

`HAPTIC_SOAK_BUSY_S`: how long (600).
"""

import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from benchmarks.scene import OBJECTS, RATE_HZ, moved, objects
from haptic_driver.client import HapticClient
from haptic_driver.daemon.messages import DaemonState, LoadPhase
from tests.haptic_driver.daemon.waiting import until_ready
from tests.soak import unpaced
from tests.soak.test_busy_machine import BUSY_S
from tests.waiting import HANG_S, until

LOAD = 4
LOAD_N = 0.5


@pytest.mark.soak
@pytest.mark.timeout(BUSY_S + 600)
@pytest.mark.parametrize("niceness", [0, 10])
def test_an_app_a_held_load_and_a_busy_machine_are_no_fault(niceness, tmp_path, busy):
    """200 objects moved 60 times a second, another client without a pause, four busy loops; also
    for a daemon that was started under `nice`.
    """
    socket = tmp_path / "run" / "daemon.sock"
    haptic = Path(sys.executable).with_name("haptic")
    words = [haptic, "daemon", "run", "--rig", "simulated-paper", "--socket", str(socket)]
    with subprocess.Popen(
        ["nice", "-n", str(niceness), *words], stderr=subprocess.PIPE, text=True
    ) as running:
        try:
            until_ready(running)
            _together(socket, busy)
        finally:
            running.terminate()
            running.stderr.read()
            running.wait(HANG_S)


def _together(socket, busy):
    with HapticClient(socket) as client, client.armed(5.0) as session:
        session.scene.change([*objects()])
        session.hold_load(LOAD_N)
        until(lambda: client.status().load.phase is LoadPhase.HOLD)
        busy(LOAD)
        command = [sys.executable, unpaced.__file__, str(socket), session.token]
        began, took_s, loads_n = client.status(), [], []
        other = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        start_s = time.monotonic()
        while (now_s := time.monotonic()) < start_s + BUSY_S:
            session.scene.change(moved(now_s))
            took_s.append(time.monotonic() - now_s)
            if len(took_s) % round(RATE_HZ) == 0:
                status = client.status()
                assert status.state is DaemonState.RENDERING, (status.fault, client.events()[-5:])
                loads_n.append(status.load.load_n)
            time.sleep(max(start_s + len(took_s) / RATE_HZ - time.monotonic(), 0.0))
        seconds, status = time.monotonic() - start_s, client.status()
        said, _ = other.communicate("", timeout=HANG_S)
    assert other.returncode == 0
    missed, due = status.overruns - began.overruns, status.ticks - began.ticks
    print(
        f"{OBJECTS} objects moved {len(took_s) / seconds:.1f} times a second, one in"
        f" {1e3 * np.median(took_s):.1f} ms, {max(took_s):.2g} s at most; beside it {said.strip()};"
        f" {missed} instants of {due} missed; load {min(loads_n):.3g} to {max(loads_n):.3g} N;"
        f" flags {status.flags}"
    )
