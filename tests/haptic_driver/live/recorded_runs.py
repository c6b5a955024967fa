"""Recordings of a finger that is simulated tick by tick: command, latency, lag, wobble, sensor
noise.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from haptic_driver.processes.samples import SAMPLE
from haptic_driver.recording.event import Event
from haptic_driver.recording.writer import Chunk, RunHeader, RunWriter
from hw.finger.plant import FingerPlant

TICK_S = 0.001
LATENCY_S = 0.030
WOBBLE_S = 0.010
HEADER = RunHeader(
    rig="bench",
    simulated=True,
    model="reference",
    surface_hash="ab12",
    calibration_ids={},
    software_version="0.1.0",
    actuator="none",
    latency_budget_s={"sensor": 0.004, "tick": 0.0005, "instrument": 0.030, "total": 0.0345},
    config={"name": "bench"},
)


class Part(NamedTuple):
    """What is commanded and done for a while; without a load the finger is off the screen."""

    duration_s: float
    frequency_hz: float = 100.0
    voltage_v: float = 0.0
    normal_force_n: float = 0.5
    speed_m_s: float = 0.02


LIFT = Part(0.2, normal_force_n=0.0, speed_m_s=0.0)


def ticks(
    parts: Sequence[Part],
    law: Callable[..., float],
    rng: np.random.Generator,
    wobble: float = 0.05,
    noise_n: float = 0.003,
    latency_s: float = LATENCY_S,
) -> np.ndarray:
    """Samples of `parts` one after the other; friction is `law`'s, varied by `wobble` with a memory
    of WOBBLE_S.
    """
    counts = [round(part.duration_s / TICK_S) for part in parts]
    made = np.zeros(sum(counts), SAMPLE)
    made["tick"] = np.arange(made.size)
    made["time_s"] = 50.0 + TICK_S * made["tick"]
    for name in Part._fields[1:]:
        made[name] = np.repeat([getattr(part, name) for part in parts], counts)
    made["in_contact"] = made["normal_force_n"] > 0.0
    made["output_on"] = made["voltage_v"] > 0.0
    made["felt_time_s"] = made["time_s"]
    made["asked_time_s"] = made["time_s"] + LATENCY_S  # as the budget has it
    delay = round(latency_s / TICK_S)
    felt_v, felt_hz = (np.roll(made[name], delay) for name in ("voltage_v", "frequency_hz"))
    felt_v[:delay] = 0.0
    plant = FingerPlant(lambda f, v, n, s: law(f, v, n, s, 0.0))
    conditions = zip(felt_hz, felt_v, made["normal_force_n"], made["speed_m_s"], strict=True)
    lateral_n = np.array([plant.step(TICK_S, *map(float, condition)) for condition in conditions])
    kept = np.exp(-TICK_S / WOBBLE_S)
    shocks = np.sqrt(1.0 - kept**2) * rng.standard_normal(made.size)
    gain = np.empty(made.size)
    last = float(rng.standard_normal())
    for i in range(made.size):
        gain[i] = last = kept * last + shocks[i]
    noise = noise_n * rng.standard_normal((2, made.size))
    made["lateral_force_n"] = lateral_n * (1.0 + wobble * gain) + noise[0]
    made["normal_force_n"] += np.where(made["in_contact"], noise[1], 0.0)
    sliding = (made["in_contact"] > 0) & (made["speed_m_s"] >= 0.002)
    with np.errstate(divide="ignore", invalid="ignore"):
        cof = np.abs(made["lateral_force_n"]) / made["normal_force_n"]
    made["measured_cof"] = np.where(sliding, cof, np.nan)
    return made


def moved(samples: np.ndarray, by_s: float) -> np.ndarray:
    """The same samples so much later."""
    later = samples.copy()
    for name in ("time_s", "felt_time_s", "asked_time_s"):
        later[name] += by_s
    return later


def record(
    path: Path, *runs: np.ndarray, header: RunHeader = HEADER, events: Sequence[Event] = ()
) -> Path:
    """A recording of these runs, each with these events."""
    for samples in runs:
        writer = RunWriter(path, header)
        writer.append(Chunk(samples, 0, [*events]))
        writer.close()
    return path
