"""How long the default surface takes: with nothing cached, and with the gap table cached. One core."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator

from benchmarks.claim import Claim

# Kernels are compiled once per installation; they are warmed on another roughness shape so that the gap table is cold.
PROGRAM = """
import os, time, dataclasses
os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
from pathlib import Path
from haptic_driver.config import load_model, load_rig
from haptic_driver.surface_builder import SurfaceAxes, build_surface
from model.parameters import Parameter
limits, reference = load_rig("simulated").operating_limits(), load_model("reference")
build_surface(load_model("table1"), limits, SurfaceAxes(frequency_count=4, voltage_count=4, normal_force_count=4))
start = time.perf_counter(); build_surface(reference, limits); cold = time.perf_counter() - start
warm = []
for _ in range(5):
    start = time.perf_counter(); build_surface(reference, limits); warm.append(time.perf_counter() - start)
print(cold, sorted(warm)[2])
"""


def run() -> Iterator[Claim]:
    with tempfile.TemporaryDirectory() as cache:
        environment = {**os.environ, "HAPTIC_CACHE_DIR": cache}
        result = subprocess.run(
            [sys.executable, "-c", PROGRAM], env=environment, capture_output=True, text=True, check=True
        )
    cold, warm = map(float, result.stdout.split())
    yield Claim("surface 200 x 128 x 5, nothing cached, one core", f"{cold:.2f} s", "under 3 s", cold < 3.0)
    yield Claim("the same with the gap table cached", f"{1e3 * warm:.0f} ms", "under 100 ms", warm < 0.1)
