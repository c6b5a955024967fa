"""400 kills and stops at random on a busy machine: zero at the electrode each time, and the daemon
comes back.

`HAPTIC_SOAK_KILLS`: how many (400); each of the four processes is killed as often as stopped, but
for the instruments: where they are stopped the daemon waits for half a minute until each line has
had its time to answer, and there is no amplifier to tell when it was at zero. `HAPTIC_SOAK_LOAD`:
busy processes beside (4). `HAPTIC_SOAK_RIG`: the name of a simulated rig (simulated),
simulated-envelope for an analog envelope. `HAPTIC_SOAK_SEED`: of the order (1).

How long each took to zero is printed as a histogram. What is late is late; how long the machine
itself stood still meanwhile (`standstill.py`) is printed beside each.
"""

import os
import random
import signal
import time
from itertools import cycle, islice
from signal import SIGKILL, SIGSTOP

import numpy as np
import pytest

from tests.haptic_driver.daemon.killing import LEASE_S, SCHEDULING_S
from tests.soak.standstill import Standstill
from tests.waiting import exists, until

KILLS = int(os.environ.get("HAPTIC_SOAK_KILLS", "400"))
LOAD = int(os.environ.get("HAPTIC_SOAK_LOAD", "4"))
RIG = os.environ.get("HAPTIC_SOAK_RIG", "simulated")
SEED = int(os.environ.get("HAPTIC_SOAK_SEED", "1"))
PROCESSES = ("render", "watchdog", "instruments", "control")
# Who has the watchdog's period to be heard, as long as a lease, goes beyond it by a dialogue;
# others: within a lease. A stopped watchdog is noticed by the next beat after its period, while the
# driver lives and wants the output.
LIMIT_S = {("control", SIGSTOP): LEASE_S + SCHEDULING_S, ("watchdog", SIGSTOP): 1.0}
STOPPED_INSTRUMENTS = KILLS // 25
LONGEST_WAIT_S = 1.0  # before each, at random
EDGES_S = (0.0, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.3, 0.5)


@pytest.mark.soak
@pytest.mark.timeout(KILLS * 60 + 600)
def test_every_kill_and_stop_leaves_zero_within_the_lease(killable_daemon, busy):
    often = [(name, sent) for sent in (SIGKILL, SIGSTOP) for name in PROCESSES]
    seldom = often.pop(often.index(("instruments", SIGSTOP)))
    chance = random.Random(SEED)
    order = [seldom] * STOPPED_INSTRUMENTS + list(islice(cycle(often), KILLS - STOPPED_INSTRUMENTS))
    chance.shuffle(order)
    took_s = {kind: [] for kind in (*often, seldom)}
    late = []
    busy(LOAD)
    standstill, daemon = Standstill(), killable_daemon(RIG)
    try:
        for number, (name, sent) in enumerate(order):
            pids = daemon.await_output()
            time.sleep(chance.uniform(0.0, LONGEST_WAIT_S))
            sent_s = time.monotonic()
            zero_s = daemon.time_to_zero_s(name, sent)
            stood_s = standstill.between_s(sent_s, sent_s + zero_s)
            took_s[name, sent].append(zero_s)
            kind = (
                f"{number}: {sent.name} {name}: {zero_s:.3f} s, the machine stood still for"
                f" {stood_s:.3f} s of it"
            )
            print(kind, flush=True)
            if zero_s > LIMIT_S.get((name, sent), LEASE_S) and name != "instruments":
                late.append(kind)
            if sent == SIGSTOP and name == "control":
                os.kill(pids[name], signal.SIGCONT)  # nobody else would; it goes on by itself
            elif name == "control":
                others = [pid for pid in pids.values() if pid != pids["control"]]
                until(
                    lambda others=others: not any(map(exists, others)),
                    lambda: "processes outlive control",
                )
                daemon.close()
                daemon = killable_daemon(RIG)
            else:
                assert daemon.await_fault()
                daemon.go_on()
    finally:
        standstill.close()
        print(_histogram(took_s), flush=True)
    assert not late, late


def _histogram(took_s):
    """A line per kind, counts from each edge on; instruments that are gone are no amplifier any
    more.
    """
    lines = [" " * 20 + "".join(f"{1e3 * edge:6.0f}" for edge in EDGES_S) + "  gone  longest, ms"]
    for (name, sent), found in sorted(took_s.items()):
        known = np.array([s for s in found if np.isfinite(s)])
        counts = np.histogram(known, [*EDGES_S, np.inf])[0]
        longest = f"{1e3 * known.max():9.0f}" if known.size else ""
        lines.append(
            f"{sent.name:8}{name:12}"
            + "".join(f"{count:6}" for count in counts)
            + f"{len(found) - known.size:6}{longest}"
        )
    return "\n".join(lines)
