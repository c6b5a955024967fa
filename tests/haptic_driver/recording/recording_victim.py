"""For each line on standard input a process of its own, which records made-up ticks of 1 ms into a
path.

A line is a number, a blank and the path. The number 0 is for recording as fast as the writer does
till it is killed. Any other is for `PIECES` pieces and the end of the run, which a kill cuts short
in the middle of the call of that number of those that change files. What is said, a line each: its
process id, after each piece how many ticks are on the disk, `done` and how many calls there were,
and last `ended` with the signal that killed it.
"""

import os
import signal
import sys
from itertools import count
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


PIECES = 3
CALLS = ("pwrite", "fsync", "link", "replace", "unlink", "sendfile", "ftruncate")


def die_in(call, done):
    """Count calls in `done`, and die in the middle of one: of `pwrite`, when half is written."""

    def counted(name, real):
        def called(*arguments, **named):
            done.append(name)
            if len(done) == call:
                if name == "pwrite":
                    descriptor, data, at = arguments
                    real(descriptor, data[: len(data) // 2], at)
                os.kill(os.getpid(), signal.SIGKILL)
            return real(*arguments, **named)

        return called

    for name in CALLS:
        setattr(os, name, counted(name, getattr(os, name)))


def record(path, call):
    done = []
    if call:
        die_in(call, done)
    writer = RunWriter(path, HEADER)
    for piece in range(PIECES) if call else count():
        first = 500 * piece
        samples = np.zeros(500, SAMPLE)
        samples["tick"] = np.arange(first, first + 500)
        samples["position_x_m"] = samples["tick"] * 1e-6
        event = Event(
            number=piece + 1, time_s=first * 1e-3, kind="marker", message=f"up to {first}"
        )
        writer.append(Chunk(samples, 0, [event]))
        os.write(1, b"%d\n" % (first + 500))
    writer.close()
    os.write(1, b"done %d\n" % len(done))


def main():
    """What is slow to import is imported once, and what a process had opened ends with it."""
    for line in sys.stdin:
        pid = os.fork()
        if pid == 0:
            try:
                call, _, path = line.removesuffix("\n").partition(" ")
                record(Path(path), int(call))
            finally:
                os._exit(1)
        os.write(1, b"pid %d\n" % pid)
        _, status = os.waitpid(pid, 0)
        os.write(1, b"ended %d\n" % -os.waitstatus_to_exitcode(status))


if __name__ == "__main__":
    main()
