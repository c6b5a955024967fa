"""An app's commands, a held load and a busy machine together: no fault but a load let go.

`HAPTIC_SOAK_BUSY_S`: how long (600).
"""

import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest

from benchmarks.scene import OBJECTS, RATE_HZ, moved, objects
from haptic_driver.client import HapticClient, LeaseLostError
from haptic_driver.daemon.messages import LoadPhase, RefusedError
from tests.haptic_driver.daemon.waiting import until_ready
from tests.soak import unpaced
from tests.soak.test_busy_machine import BUSY_S
from tests.waiting import HANG_S, until

LOAD = 4
LOAD_N = 0.5
LATE_SENSOR = "the load stage lets go: the force sensor is silent"


@pytest.mark.soak
@pytest.mark.timeout(BUSY_S + 600)
@pytest.mark.parametrize("niceness", [0, 10])
def test_nothing_trips_but_a_load_that_is_let_go(niceness, tmp_path, busy):
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
    with HapticClient(socket) as client:
        with suppress(LeaseLostError), client.armed(5.0) as session:
            session.scene.change([*objects()])
            session.hold_load(LOAD_N)
            until(lambda: client.status().load.phase is LoadPhase.HOLD)
            busy(LOAD)
            command = [sys.executable, unpaced.__file__, str(socket), session.token]
            with subprocess.Popen(
                command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
            ) as other:
                began, took_s, loads_n, seconds = _moved(client, session)
                said, _ = other.communicate("", timeout=HANG_S)
        status = client.status()
        if status.fault is not None:
            print(f"after {seconds:.0f} s: {status.fault}")
            assert status.fault.startswith(LATE_SENSOR)
            until(lambda: client.status().load.phase is LoadPhase.FREE)
    missed, due = status.overruns - began.overruns, status.ticks - began.ticks
    print(
        f"{OBJECTS} objects moved {len(took_s) / seconds:.1f} times a second, one in"
        f" {1e3 * np.median(took_s):.1f} ms, {max(took_s):.2g} s at most; beside it {said.strip()};"
        f" {missed} instants of {due} missed; load {min(loads_n):.3g} to {max(loads_n):.3g} N;"
        f" flags {status.flags}"
    )


def _moved(client, session):
    """Until the time is over or the lease is lost: the first status, what each change took, loads
    once a second, and the time.
    """
    began, took_s, loads_n, start_s = client.status(), [], [], time.monotonic()
    with suppress(RefusedError):
        while (now_s := time.monotonic()) < start_s + BUSY_S:
            session.scene.change(moved(now_s))
            took_s.append(time.monotonic() - now_s)
            if len(took_s) % round(RATE_HZ) == 0:
                loads_n.append(client.status().load.load_n)
            time.sleep(max(start_s + len(took_s) / RATE_HZ - time.monotonic(), 0.0))
    return began, took_s, loads_n, time.monotonic() - start_s
