"""A daemon with a client of its own, as a process that a test may kill; not a test.

    python killable.py AMPLIFIER_RECORD RIG [LOAD_N]

arms, sets a friction and renews. With a load it has the load stage hold it, and renders then.
Reports every change of state as a JSON line, with the process ids at that time, where simulated
instruments are, and the kernels first used after the start: to compile one takes longer than a
lease. A line on standard input makes it reset what is in fault and go on; the end of standard input
ends it.
"""

from __future__ import annotations

import json
import os
import select
import sys
import time
from contextlib import suppress
from pathlib import Path

from haptic_driver.daemon.daemon import Daemon
from haptic_driver.daemon.messages import DaemonState, LoadPhase
from haptic_driver.daemon.set_up import daemon_settings
from haptic_driver.errors import HapticError
from haptic_driver.processes.real_time import take_precedence
from haptic_driver.render import compiled

LEASE_S = 0.5
FRICTION = 0.65


def used() -> set[str]:
    return {kernel.py_func.__name__ for kernel in compiled.KERNELS if kernel.signatures}


def report(daemon: Daemon, state: str, late: set[str]) -> None:
    pids = {"control": os.getpid(), **daemon.pids}
    said = {
        "state": state,
        "pids": pids,
        "fault": daemon.status().fault,
        "late_kernels": sorted(late),
        "endpoints": daemon.supervisor.endpoints,
    }
    print(json.dumps(said), flush=True)


def is_held(daemon: Daemon, load_n: float) -> bool:
    load = daemon.status().load
    return load.phase is LoadPhase.HOLD and (load.load_n or 0.0) > 0.9 * load_n


def go(daemon: Daemon, load_n: float | None = None) -> str:
    """Reset, arm, press and render, as soon as that is possible; the token."""
    while True:
        try:
            if daemon.status().state is DaemonState.FAULT:
                daemon.reset()
            daemon.disarm()
            lease = daemon.arm(LEASE_S)
            if load_n is not None:
                daemon.hold_load(lease.token, load_n)
                while not is_held(daemon, load_n):
                    daemon.renew(lease.token)
                    time.sleep(0.02)
            daemon.targets.set(lease.token, FRICTION)
            return lease.token
        except HapticError:
            time.sleep(0.05)


def main() -> None:
    record, rig = Path(sys.argv[1]), sys.argv[2]
    load_n = float(sys.argv[3]) if len(sys.argv) > 3 else None
    take_precedence()  # as `haptic daemon run` does
    with Daemon(daemon_settings(rig, "reference", amplifier_record=record)) as daemon:
        ready = used()
        token, told = go(daemon, load_n), None
        while True:
            state = daemon.status().state
            if state is DaemonState.RENDERING:
                with suppress(HapticError):  # too late, on a loaded machine
                    daemon.renew(token)
            elif state is not DaemonState.FAULT:
                token = go(daemon, load_n)
                continue
            if state != told:
                report(daemon, state, used() - ready)
                told = state
            if select.select([sys.stdin], [], [], 0.02)[0]:
                if not sys.stdin.readline():
                    return
                token = go(daemon, load_n)


if __name__ == "__main__":
    main()
