"""An app's commands, a held load and a busy machine together: no fault but a load let go.

`HAPTIC_SOAK_BUSY_S`: how long (600).
"""

import json
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from benchmarks.scene import OBJECTS
from haptic_driver.client import HapticClient
from haptic_driver.daemon.messages import LoadPhase
from tests.haptic_driver.daemon.waiting import until_ready
from tests.soak import unpaced
from tests.soak.movers import in_a_browser, in_python
from tests.soak.test_busy_machine import BUSY_S
from tests.waiting import HANG_S, until

LOAD = 4
LOAD_N = 0.5
LATE_SENSOR = "the load stage lets go: the force sensor is silent"


@pytest.mark.soak
@pytest.mark.timeout(BUSY_S + 600)
@pytest.mark.parametrize("niceness", [0, 10])
@pytest.mark.parametrize("begin", [in_python, in_a_browser])
def test_nothing_trips_but_a_load_that_is_let_go(begin, niceness, tmp_path, busy):
    """200 objects moved 60 times a second, another client without a pause, four busy loops; also
    for a daemon that was started under `nice`.
    """
    socket = tmp_path / "run" / "daemon.sock"
    haptic = Path(sys.executable).with_name("haptic")
    words = [haptic, "daemon", "run", "--rig", "simulated-paper", "--socket", str(socket)]
    with subprocess.Popen(
        ["nice", "-n", str(niceness), *words, "--port", "0", "--json"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as running:
        try:
            until_ready(running)
            page = json.loads(running.stdout.readline())["page"]
            with HapticClient(socket) as client, begin(client, page) as mover:
                _together(socket, client, mover, busy)
        finally:
            running.terminate()
            running.stderr.read()
            running.wait(HANG_S)


def _together(socket, client, mover, busy):
    """Until the time is over or the lease is lost; prints what came of it."""
    client.hold_load(mover.token, LOAD_N)
    until(lambda: _holds(client.status().load))
    busy(LOAD)
    loads_n, began, start_s = [], client.status(), time.monotonic()

    def is_over():
        load_n = client.status().load.load_n
        loads_n.append(np.nan if load_n is None else load_n)
        return time.monotonic() > start_s + BUSY_S

    command = [sys.executable, unpaced.__file__, str(socket), mover.token]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
    with subprocess.Popen(command, **pipes, text=True) as other:
        took_s = mover.moved_until(is_over)
        seconds = time.monotonic() - start_s
        said, _ = other.communicate("", timeout=HANG_S)
    status = client.status()
    missed, due = status.overruns - began.overruns, status.ticks - began.ticks
    print(
        f"{OBJECTS} objects moved {len(took_s) / seconds:.1f} times a second, one in"
        f" {1e3 * np.median(took_s):.1f} ms, {max(took_s):.2g} s at most; beside it {said.strip()};"
        f" {missed} instants of {due} missed; load {np.nanmin(loads_n):.3g} to"
        f" {np.nanmax(loads_n):.3g} N; flags {status.flags}; {seconds:.0f} s"
    )
    if status.fault is not None:
        print(f"fault: {status.fault}")
        assert status.fault.startswith(LATE_SENSOR)
        until(lambda: client.status().load.phase is LoadPhase.FREE)


def _holds(load):
    """After the first touch, about as much as was asked for."""
    return load.phase is LoadPhase.HOLD and load.load_n > 0.9 * LOAD_N
