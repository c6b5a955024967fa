"""The stages of a tick alone: as compiled, as pure Python, and scipy's interpolator against them,
in one run.

What a whole tick in the daemon takes is promised and measured in `tick_lateness`.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from scipy.interpolate import RegularGridInterpolator

from benchmarks.claim import Claim
from haptic_driver.lookup.build import build_surface
from haptic_driver.lookup.file import SurfaceFile, ready_for_lookup
from haptic_driver.lookup.models import load_model
from haptic_driver.render.controller import Controller, ControllerSettings
from haptic_driver.render.drive import DriveSettings
from haptic_driver.render.feedback import FeedbackSettings
from haptic_driver.render.finger import FingerSettings
from haptic_driver.render.safety import table_of
from haptic_driver.render.texture import Grating
from haptic_driver.render.tick import TickSettings, TickState, tick
from haptic_driver.rig.config import load_rig
from haptic_driver.signals import FingerSample

TICKS, PURE_TICKS, FIRST = 10_000, 300, 100


def settings() -> tuple[TickSettings, SurfaceFile]:
    """A grating on the simulated rig, everything switched on that a rig may have."""
    config = load_rig("simulated")
    limits = config.operating_limits()
    file = build_surface(load_model("reference"), limits)
    law = FeedbackSettings(config.output.latency_s)
    controller = Controller(
        ControllerSettings(ready_for_lookup(file, limits), limits, feedback=law)
    )
    stages = TickSettings(
        FingerSettings(),
        Grating(0.7, 0.1, 0.01),
        controller,
        limits,
        DriveSettings(),
        table_of(file.worst_case(limits)),
    )
    return stages, file


def ticks_s(stages: TickSettings, count: int) -> np.ndarray:
    """Processor time of each of `count` ticks under a sliding finger whose forces are noisy."""
    rng = np.random.default_rng(7)
    noise_n = rng.normal(0.0, 0.003, (count, 2)).tolist()
    samples = [
        FingerSample(1.0 + 1e-3 * k, 0.01 + 5e-5 * (k % 1000), 0.0, 0.5 + n, 0.35 + m)
        for k, (n, m) in enumerate(noise_n)
    ]
    state, times = TickState(), np.empty(count)
    for k, sample in enumerate(samples):
        start = time.thread_time()
        state, _ = tick(stages, state, sample)
        times[k] = time.thread_time() - start
    return times[FIRST:]


def with_scipy_s(file: SurfaceFile) -> float:
    """The one step of finding a voltage, as one would write it: the surface along voltage, then
    interpolated back.
    """
    lookup = RegularGridInterpolator(
        (np.log(file.frequency_hz), file.voltage_v, np.log(file.normal_force_n)),
        np.nan_to_num(file.cof),
    )
    points = np.empty((file.voltage_v.size, 3))
    points[:, 1] = file.voltage_v
    times = []
    for k in range(1000):
        start = time.thread_time()
        points[:, 0], points[:, 2] = np.log(250.0), np.log(0.5)
        np.interp(0.6 + 1e-4 * k, lookup(points), file.voltage_v)
        times.append(time.thread_time() - start)
    return float(np.median(times))


def run() -> Iterator[Claim]:
    stages, file = settings()
    p50, p99 = np.percentile(ticks_s(stages, TICKS), [50, 99])
    yield Claim(
        "the stages of a tick, with feedback",
        f"{1e6 * p50:.1f} us median, {1e6 * p99:.1f} us at 99 %",
    )
    plain = replace(
        stages, controller=Controller(replace(stages.controller.settings, feedback=None))
    )
    p50_plain, p99_plain = np.percentile(ticks_s(plain, TICKS), [50, 99])
    yield Claim(
        "the same without feedback",
        f"{1e6 * p50_plain:.1f} us median, {1e6 * p99_plain:.1f} us at 99 %",
    )
    pure = subprocess.run(
        [sys.executable, "-m", "benchmarks.tick_compute"],
        env={**os.environ, "NUMBA_DISABLE_JIT": "1"},
        capture_output=True,
        text=True,
        check=True,
    )
    pure_s = float(pure.stdout)
    yield Claim(
        "the same stages in pure Python, median", f"{1e6 * pure_s:.0f} us, {pure_s / p50:.1f} x"
    )
    scipy_s = with_scipy_s(file)
    yield Claim(
        "finding one voltage with RegularGridInterpolator, against all stages",
        f"{1e6 * scipy_s:.0f} us, {scipy_s / p50:.1f} x",
    )


if __name__ == "__main__":  # in an interpreter without compiled code
    print(np.median(ticks_s(settings()[0], PURE_TICKS)))
