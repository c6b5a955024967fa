"""Strokes as a rig might have measured them, and data files that belong to them."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from haptic_driver.lab.strokes.file import SAMPLE, KeptStroke, StrokeRow, StrokesFile, strokes_path

ABOUT: dict[str, str | float] = {"plan": "p", "model": "m", "rig": "r", "simulated": 1.0}
SPEED_M_S, LOAD_N = 0.02, 0.5
COLUMNS = (
    "frequency_hz",
    "voltage_v",
    "normal_force_n",
    "cof",
    "speed_m_s",
    "time_s",
    "session",
    "trial",
    "measured_normal_force_n",
)


def stroke(
    row: int = 1,
    *,
    cof: float = 0.6,
    frequency_hz: float = 250.0,
    voltage_v: float = 75.0,
    trial: int = 1,
    window_m: tuple[float, float] = (0.015, 0.035),
    load_n: float = LOAD_N,
) -> KeptStroke:
    """35 mm at 20 mm/s; friction is 0.5 until the window, `cof` in it."""
    time_s = 0.0025 + 0.005 * np.arange(350)
    samples = np.zeros(time_s.size, SAMPLE)
    samples["time_s"] = 10.0 * row + time_s
    samples["displacement_m"] = SPEED_M_S * time_s
    samples["position_m"] = 0.05 + SPEED_M_S * time_s
    samples["velocity_m_s"] = SPEED_M_S
    samples["normal_force_n"] = load_n
    samples["steady"] = samples["displacement_m"] > window_m[0]
    samples["lateral_force_n"] = load_n * np.where(samples["steady"], cof, 0.5)
    samples["monitor_voltage_v"], samples["monitor_current_a"] = voltage_v, np.nan
    told = (row, 1, trial, frequency_hz, voltage_v, LOAD_N, SPEED_M_S, 0.0, "sine", *window_m)
    return KeptStroke(StrokeRow(*told), samples)


def written(path: Path, strokes: Sequence[KeptStroke]) -> Path:
    with StrokesFile.create(path, ABOUT) as file:
        for one in strokes:
            file.append(one)
    return path


def data_file(data: Path, strokes: Sequence[KeptStroke]) -> Path:
    """A CSV whose frictions are those of the strokes in their windows, which lie beside it."""
    with data.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(COLUMNS)
        for one in strokes:
            row, samples = one.row, one.samples[one.samples["steady"] == 1]
            lateral_n, load_n = samples["lateral_force_n"].mean(), samples["normal_force_n"].mean()
            commanded = (row.frequency_hz, row.voltage_v, row.commanded_normal_force_n)
            when = (row.speed_m_s, samples["time_s"].mean(), row.session, row.trial)
            writer.writerow([*commanded, lateral_n / load_n, *when, load_n])
    written(strokes_path(data), strokes)
    return data
