"""A loop with the scheduling of ticks, which does reference work alone.

python -m benchmarks.empty_loop TICKS PERIOD_S FILE

leaves in FILE how late each turn was and how long its work took, s [TICKS, 2].
"""

from __future__ import annotations

import sys
import time

import numpy as np

from benchmarks.reference import hand_on_records
from haptic_driver.processes import real_time


def main() -> None:
    ticks, period_s, path = int(sys.argv[1]), float(sys.argv[2]), sys.argv[3]
    found_s = np.zeros((ticks, 2))
    granted = real_time.enter()
    real_time.settle_memory()
    beat = granted.metronome(period_s)
    for k in range(ticks):
        due = beat.wait()
        began_s = time.monotonic()
        hand_on_records()
        found_s[k] = due.lateness_s, time.monotonic() - began_s
    np.save(path, found_s)


if __name__ == "__main__":
    main()
