"""A folder of raw trials as a lab has them, by the blind generator's finger, which is not the
model's: `python -m tests.docs.own_data FOLDER`.

Each file has a header, decimal commas, ms, gf, mN, mm and a monitor's volts. Loads are as measured
and scatter, every trial has a gain of its own, and one file is cut short. Air in the gap conducts,
as on a humid day.
"""

from __future__ import annotations

import re
import sys
from itertools import product
from pathlib import Path

import numpy as np

from tests.blind.generator.nuisance import ROUGHNESS
from tests.blind.generator.touch import VACUUM, Finger, Rows, friction, prepare

SEED = 20
RATE_HZ = 250.0
ON_S, OFF_S, END_S = 1.0, 2.4, 2.8
SPEED_M_S = 0.02
GF_N = 9.80665e-3
FREQUENCIES_HZ = (10, 40, 160, 640)
VOLTAGES_V = (60, 100, 140)
LOADS_N = (0.3, 0.8)
SESSIONS = (1, 2, 3)
HUMID_S_PER_M = 8e-9
LOAD_SCATTER, TRIAL_GAIN, NOISE = 0.08, 0.03, 0.02
FX_OFFSET_MN = 12.0
HEADER = "Messung Reibung\nProbe;{name}\nAbtastrate;250 Hz\nSensor;Nano17\n\n"
COLUMNS = "Zeit;Fz;Fx;HV-Monitor;Weg\nms;gf;mN;V;mm\n"


def cof(frequency_hz: float, voltage_v: float, load_n: float) -> float:
    """Friction of one finger over conducting air."""
    one = np.ones(1)
    rows = Rows(frequency_hz * one, voltage_v * one, load_n * one, SPEED_M_S * one, 0.0 * one)
    state = prepare(rows, Finger(), ROUGHNESS)
    state.k_gap = state.k_gap + HUMID_S_PER_M / (1j * state.omega * VACUUM)
    return float(friction(state)[0])


def text_of(name: str, columns: np.ndarray) -> str:
    lines = [";".join(f"{value:.5g}" for value in row).replace(".", ",") for row in columns]
    return HEADER.format(name=name) + COLUMNS + "\n".join(lines) + "\n"


def trial(rng: np.random.Generator, frequency_hz: float, voltage_v: float, load_n: float):
    """The columns [n, 5] of one trial, as its sensors say them."""
    time_s = np.arange(round(END_S * RATE_HZ)) / RATE_HZ
    pressed_n = load_n * np.exp(LOAD_SCATTER * rng.normal())
    on = (time_s >= ON_S) & (time_s < OFF_S)
    felt = np.where(on, cof(frequency_hz, voltage_v, pressed_n), cof(250.0, 0.0, pressed_n))
    felt = felt * np.exp(TRIAL_GAIN * rng.normal())
    normal_n = pressed_n * (1.0 + 0.01 * rng.normal(size=time_s.size))
    lateral_n = felt * pressed_n * (1.0 + NOISE * rng.normal(size=time_s.size))
    return np.column_stack(
        [
            1e3 * time_s,
            -normal_n / GF_N,
            1e3 * lateral_n + FX_OFFSET_MN,
            np.where(on, voltage_v / 100.0, 0.0) + 0.002 * rng.normal(size=time_s.size),
            1e3 * SPEED_M_S * time_s,
        ]
    )


def write(folder: Path) -> None:
    """All trials, the last but one cut in the middle of a line."""
    rng = np.random.default_rng(SEED)
    folder.mkdir(parents=True)
    every = list(product(SESSIONS, LOADS_N, VOLTAGES_V, FREQUENCIES_HZ))
    for number, (session, load_n, voltage_v, frequency_hz) in enumerate(every, start=1):
        load = f"{load_n:g}".replace(".", "p")
        name = f"day{session}_{voltage_v}V_{frequency_hz}Hz_{load}N_t{number:02d}"
        text = text_of(name, trial(rng, frequency_hz, voltage_v, load_n))
        if number == len(every) - 1:
            text = text[: len(text) // 2]
        (folder / f"{name}.csv").write_text(text, encoding="cp1252")


def map_of(page: Path) -> str:
    """The map that the page shows."""
    return re.findall(r"^```toml\n(.*?)^```", page.read_text("utf-8"), re.DOTALL | re.MULTILINE)[0]


if __name__ == "__main__":
    write(Path(sys.argv[1]))
