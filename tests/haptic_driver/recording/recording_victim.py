"""Records made-up ticks of 1 ms as fast as the writer goes, saying after each piece how many are on the disk."""

import sys
from pathlib import Path

import numpy as np

from haptic_driver.processes.samples import SAMPLE
from haptic_driver.recording.event import Event
from haptic_driver.recording.writer import Chunk, RunHeader, RunWriter

HEADER = RunHeader(
    rig="by hand", simulated=True, model="reference", surface_hash="abc", calibration_ids={"force_sensor": "FT1"},
    software_version="0", actuator="none", latency_budget_s={"total": 0.01}, config={"name": "by hand"},
)  # fmt: skip


def main():
    writer = RunWriter(Path(sys.argv[1]), HEADER)
    first = 0
    while True:
        samples = np.zeros(500, SAMPLE)
        samples["tick"] = np.arange(first, first + 500)
        samples["position_x_m"] = samples["tick"] * 1e-6
        event = Event(number=first // 500 + 1, time_s=first * 1e-3, kind="marker", message=f"up to {first}")
        first += 500
        writer.append(Chunk(samples, 0, [event]))
        print(first, flush=True)


if __name__ == "__main__":
    main()
