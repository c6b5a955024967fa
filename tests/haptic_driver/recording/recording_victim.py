"""For each path on standard input a process of its own, which records made-up ticks of 1 ms there
till it is killed.

It goes as fast as the writer does. What is said, a line each: its process id, after each piece how
many ticks are on the disk, and last `ended` with the signal that killed it.
"""

import os
import sys
from pathlib import Path

import numpy as np

from haptic_driver.processes.samples import SAMPLE
from haptic_driver.recording.event import Event
from haptic_driver.recording.writer import Chunk, RunHeader, RunWriter

HEADER = RunHeader(
    rig="by hand",
    simulated=True,
    model="reference",
    surface_hash="abc",
    calibration_ids={"force_sensor": "FT1"},
    software_version="0",
    actuator="none",
    latency_budget_s={"total": 0.01},
    config={"name": "by hand"},
)


def record(path):
    writer = RunWriter(path, HEADER)
    first = 0
    while True:
        samples = np.zeros(500, SAMPLE)
        samples["tick"] = np.arange(first, first + 500)
        samples["position_x_m"] = samples["tick"] * 1e-6
        event = Event(
            number=first // 500 + 1, time_s=first * 1e-3, kind="marker", message=f"up to {first}"
        )
        first += 500
        writer.append(Chunk(samples, 0, [event]))
        os.write(1, b"%d\n" % first)


def main():
    """What is slow to import is imported once, and what a process had opened ends with it."""
    for line in sys.stdin:
        pid = os.fork()
        if pid == 0:
            try:
                record(Path(line.removesuffix("\n")))
            finally:
                os._exit(1)
        os.write(1, b"pid %d\n" % pid)
        _, status = os.waitpid(pid, 0)
        os.write(1, b"ended %d\n" % -os.waitstatus_to_exitcode(status))


if __name__ == "__main__":
    main()
