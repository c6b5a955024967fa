"""How late ticks are against an empty loop of the same scheduling in the same run, and how soon a new target acts."""

from __future__ import annotations

import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from benchmarks.claim import Claim
from haptic_driver.daemon.control_process import Daemon
from haptic_driver.daemon.set_up import daemon_settings

SECONDS = 30.0
ROUNDS = 100
WANTED_RATIO, WANTED_S = 1.2, 5e-3
EMPTY = """
import sys
import numpy as np
from haptic_driver.daemon import real_time
ticks = int(sys.argv[1])
lateness_s = np.zeros(ticks)
granted = real_time.enter()
real_time.settle_memory()
beat = granted.metronome(0.001)
for i in range(ticks):
    lateness_s[i] = beat.wait().lateness_s
np.save(sys.argv[2], lateness_s)
"""


def run() -> Iterator[Claim]:
    with tempfile.TemporaryDirectory() as folder:
        record, empty = Path(folder, "amplifier.txt"), Path(folder, "empty.npy")
        settings = daemon_settings("simulated", "reference", amplifier_record=record)
        with Daemon(settings) as daemon:
            lease = daemon.arm(60.0)
            daemon.set_target(lease.token, 0.65)
            yield _lateness(daemon, lease.token, empty)
            yield from _set_to_output(daemon, lease.token, record)
            daemon.off()


def _lateness(daemon: Daemon, token: str, empty: Path) -> Claim:
    """Both at the same time, so that both meet the same load of the machine."""
    last = daemon.status().ticks
    process = subprocess.Popen([sys.executable, "-c", EMPTY, str(round(SECONDS * 1e3)), str(empty)])
    ticks, computed = [], []
    while process.poll() is None:
        time.sleep(1.0)
        daemon.renew(token)
        samples = daemon.samples(last, 1 << 14)
        last = int(samples["tick"][-1])
        ticks.append(samples["lateness_s"])
        computed.append(samples["compute_s"])
    loaded, idle = np.concatenate(ticks), np.load(empty)
    median, tail = (float(np.percentile(loaded, q) / np.percentile(idle, q)) for q in (50.0, 99.9))
    described = (
        f"{median:.2f} and {tail:.2f} (ticks {_us(loaded)}, empty loop {_us(idle)} us; "
        f"compute {1e6 * np.median(np.concatenate(computed)):.0f} us; "
        f"real time {'granted' if daemon.status().real_time else 'NOT granted'}, {os.cpu_count()} cores)"
    )
    wanted = f"at most {WANTED_RATIO} times those of an empty loop"
    return Claim("tick lateness at 1 kHz, median and 99.9 %", described, wanted, max(median, tail) <= WANTED_RATIO)


def _us(lateness_s: np.ndarray) -> str:
    return "/".join(f"{1e6 * np.percentile(lateness_s, q):.0f}" for q in (50.0, 99.9))


def _set_to_output(daemon: Daemon, token: str, record: Path) -> Iterator[Claim]:
    """From the call to the first tick that renders the new target, and to the change at the simulated electrode."""
    decided, acted = [], []
    latency_s = daemon.settings.config.simulation.amplitude_latency_s
    cof = 0.60
    for i in range(ROUNDS):
        while not daemon.shared.output.read().output_on:
            time.sleep(0.01)
            daemon.renew(token)
        time.sleep(0.05 + 0.0037 * (i % 10))
        cof = 0.68 if cof == 0.60 else 0.60
        before = daemon.shared.output.read()
        began_s = time.monotonic()
        daemon.set_target(token, cof)
        time.sleep(latency_s + 0.04)
        samples = daemon.samples(before.tick, 1000)
        new = samples[samples["target_cof"] == cof]
        if not new.size or not new["output_on"].all():
            continue  # the finger lifted
        decided.append(float(new["time_s"][0] + new["lateness_s"][0] + new["compute_s"][0]) - began_s)
        later = [tuple(map(float, line.split())) for line in record.read_text().splitlines()[-200:]]
        changed = [t - began_s for t, _, v in later if t > began_s and abs(v / before.voltage_v - 1.0) > 0.1]
        acted.extend(changed[:1])
    interval_s = daemon.settings.config.output.setpoint_interval_s
    yield _claim("set to changed output, in shared memory", decided, WANTED_S)
    yield _claim(
        f"set to changed electrode, over SCPI every {1e3 * interval_s:.0f} ms to a generator that takes "
        f"{1e3 * latency_s:.0f} ms", acted, interval_s + latency_s,
    )  # fmt: skip


def _claim(what: str, times_s: list[float], wanted_s: float) -> Claim:
    median_s = statistics.median(times_s)
    described = f"{1e3 * median_s:.2f} ms median of {len(times_s)}"
    return Claim(what, described, f"under {1e3 * wanted_s:.0f} ms", median_s < wanted_s)


if __name__ == "__main__":
    for claim in run():
        print(f"{claim.what}: {claim.measured} (wanted {claim.wanted}): {'holds' if claim.holds else 'DOES NOT HOLD'}")
