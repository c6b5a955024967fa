"""What the machine allowed while a test ran: an empty loop beside it, in a process of its own.

    python machine.py

wakes on each processor every few milliseconds and says when it woke late, as `from_s until_s` on
the monotonic clock. It weighs what the tests and the daemons that they start weigh.
"""

from __future__ import annotations

import os
import subprocess
import sys
import threading
import time
from itertools import pairwise

SLEEP_S = 0.005
# Half of what a sensor, a lease or a watchdog waits for at least (0.2 s): less is no excuse.
LATE_S = 0.1


class EmptyLoop:
    """Notes when the machine kept it waiting, until `close`."""

    def __init__(self) -> None:
        self._process = subprocess.Popen(
            [sys.executable, __file__], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        self._waits: list[tuple[float, float]] = []
        self._reader = threading.Thread(target=self._read)
        self._reader.start()

    def _read(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            from_s, until_s = map(float, line.split())
            self._waits.append((from_s, until_s))

    def longest_wait_s(self, since_s: float) -> float:
        """The longest time that it was kept waiting since then; 0 where it was never late."""
        return max((until - start for start, until in self._waits if until > since_s), default=0.0)

    def signal(self, number: int) -> None:
        """Send its process a signal."""
        self._process.send_signal(number)

    def close(self) -> None:
        self._process.kill()
        self._process.wait()
        self._reader.join()
        for pipe in (self._process.stdin, self._process.stdout):
            assert pipe is not None
            pipe.close()


def _wakes():
    while True:
        time.sleep(SLEEP_S)
        yield time.monotonic()


def _watch(processor: int) -> None:
    os.sched_setaffinity(0, {processor})
    for before_s, now_s in pairwise(_wakes()):
        if now_s - before_s > SLEEP_S + LATE_S:
            # In one piece, as two threads say so at the same time.
            os.write(sys.stdout.fileno(), f"{before_s + SLEEP_S} {now_s}\n".encode())


def main() -> None:
    for processor in os.sched_getaffinity(0):
        threading.Thread(target=_watch, args=(processor,), daemon=True).start()
    # The end of input means that the tests are gone.
    sys.stdin.read()


if __name__ == "__main__":
    main()
