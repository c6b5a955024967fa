"""When the machine itself stood still; and its sleeper, a program of its own.

    python standstill.py CPU

A virtual machine is kept waiting by its host, by a tenth of a second and more at a time where it
asks for more than its share. No precedence inside helps against that. A sleeper of the highest
precedence on each processor, that wakes every few milliseconds, notices.
"""

from __future__ import annotations

import os
import subprocess
import sys
import threading
import time
from itertools import pairwise

SLEEP_S = 0.005
LEAST_S = 0.02  # that counts as standing still


class Standstill:
    """Notes when each processor stood still, until `close`; nothing where no such precedence is
    granted.
    """

    def __init__(self) -> None:
        cpus = sorted(os.sched_getaffinity(0))
        self._sleepers = [
            subprocess.Popen(
                [sys.executable, __file__, str(cpu)], stdout=subprocess.PIPE, text=True
            )
            for cpu in cpus
        ]
        self._noted: list[tuple[float, float]] = []
        self._readers = [
            threading.Thread(target=self._read, args=(p.stdout,)) for p in self._sleepers
        ]
        for reader in self._readers:
            reader.start()

    def _read(self, lines) -> None:
        for line in lines:
            from_s, to_s = map(float, line.split())
            self._noted.append((from_s, to_s))

    def between_s(self, from_s: float, to_s: float) -> float:
        """How long processors stood still between two times of the monotonic clock, added up over
        all of them.
        """
        return sum(
            max(0.0, min(to_s, end_s) - max(from_s, begin_s)) for begin_s, end_s in self._noted
        )

    def close(self) -> None:
        for sleeper in self._sleepers:
            sleeper.kill()
            sleeper.wait()
        for reader in self._readers:
            reader.join()
        for sleeper in self._sleepers:
            sleeper.stdout.close()


def _wakes():
    while True:
        time.sleep(SLEEP_S)
        yield time.monotonic()


def main() -> None:
    os.sched_setaffinity(0, {int(sys.argv[1])})
    os.sched_setscheduler(
        0, os.SCHED_FIFO, os.sched_param(os.sched_get_priority_max(os.SCHED_FIFO))
    )
    for before_s, now_s in pairwise(_wakes()):
        if now_s - before_s > SLEEP_S + LEAST_S:
            print(before_s + SLEEP_S, now_s, flush=True)


if __name__ == "__main__":
    main()
