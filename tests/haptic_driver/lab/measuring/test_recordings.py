"""Recordings as measured data: `haptic_driver/lab/measuring/recordings.py`, `haptic diagnose` and
`haptic calibrate`.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from haptic_driver.fidelity.average import WINDOW_COLUMNS
from haptic_driver.lab.measuring.data_file import COLUMNS
from haptic_driver.lab.measuring.recordings import read_data, write_recorded
from haptic_driver.processes.samples import Flag
from haptic_driver.simulation.finger_model import friction_of
from model.conditions import Conditions
from tests.haptic_driver.commands import rows_of, said_by
from tests.haptic_driver.lab.refusal import refused
from tests.haptic_driver.live.recorded_runs import HEADER, LIFT, Part, record, ticks

CARRIERS_HZ, VOLTAGES_V, LOADS_N = (5.0, 20.0, 80.0, 250.0), (60.0, 100.0, 130.0), (0.3, 0.8)
PAUSE = LIFT._replace(duration_s=6.0)


def strokes(sessions: int, part_s: float = 0.35) -> list[Part]:
    """Every carrier, voltage and load, and none; a stroke holds three voltages, with no pause
    between them.
    """
    parts: list[Part] = []
    for _ in range(sessions):
        for frequency_hz in CARRIERS_HZ:
            for load_n in LOADS_N:
                parts += [Part(part_s, frequency_hz, v, load_n) for v in (0.0, *VOLTAGES_V)] + [
                    LIFT
                ]
        parts[-1] = PAUSE
    return parts


def column(rows, name):
    return np.array([float(row[name]) for row in rows])


def test_rows_agree_with_the_finger_within_what_they_state(touch, rng, tmp_path):
    """Also right after a step of the voltage, which friction follows 30 ms and some lag later."""
    out = tmp_path / "rows.csv"
    parts = strokes(3)
    count = write_recorded(
        [record(tmp_path / "run.h5", ticks(parts, friction_of(touch), rng))], out
    )
    rows = rows_of(out)
    assert set(rows[0]) == {*WINDOW_COLUMNS, "simulated"} <= set(COLUMNS)
    assert count == len(rows) >= sum(part.normal_force_n > 0.0 for part in parts)
    f, v, n, s, cof, std = (
        column(rows, x)
        for x in ("frequency_hz", "voltage_v", "normal_force_n", "speed_m_s", "cof", "cof_std")
    )
    z = (cof - touch.predict(Conditions(f, v, n, speed_m_s=s)).cof) / std
    assert abs(np.mean(z)) < 4.0 / np.sqrt(count)
    assert np.mean(z**2) == pytest.approx(1.0, abs=4.0 * np.sqrt(2.0 / count))
    known = [
        (part.frequency_hz if part.voltage_v else 0.0, part.voltage_v)
        for part in parts
        if part.normal_force_n
    ]
    assert set(zip(f, v, strict=True)) == set(known)


@pytest.mark.parametrize(
    ("speed_m_s", "late", "waited_s"),
    [(0.005, 0, 0.0), (0.05, 0, 0.0), (0.05, 30, 0.0), (0.05, 0, 0.002)],
)
def test_a_texture_finer_than_a_row_gives_rows_of_the_finger(
    rng, tmp_path, speed_m_s, late, waited_s
):
    """Threads of 2 mm, 2.5 and 25 a second, by an envelope: friction never settles. A late control
    repeats readings.

    Where the envelope waited 2 ms longer than its budget says, low voltages felt stronger and high
    ones weaker.
    """

    def law(frequency_hz, voltage_v, normal_force_n, *_):
        power = voltage_v**2 / 1e4
        return normal_force_n * (0.5 + 0.25 * power + 0.04 * power**2)

    time_s = np.arange(0.0, 12.0, 0.001)
    voltages_v = np.sqrt(4500.0 + 4300.0 * np.sin(2.0 * np.pi * speed_m_s * time_s / 0.002))
    parts = [Part(0.001, 100.0, float(voltage_v), 0.5, speed_m_s) for voltage_v in voltages_v]
    budget = {
        "sensor": 0.004,
        "tick": 0.0005,
        "envelope": 0.002,
        "instrument": 0.001,
        "total": 0.0075,
    }
    made = ticks(parts, law, rng, wobble=0.03, latency_s=0.003 + waited_s)
    made["asked_time_s"] = made["time_s"] + 0.003
    heard = np.where(made["tick"] % 100 < late, made["tick"] // 100 * 100, made["tick"]).astype(
        np.intp
    )
    for name in ("normal_force_n", "lateral_force_n", "measured_cof", "felt_time_s"):
        made[name] = made[name][heard]
    path = record(tmp_path / "run.h5", made, header=replace(HEADER, latency_budget_s=budget))
    rows = read_rows(path, tmp_path)
    v, cof, std = (column(rows, name) for name in ("voltage_v", "cof", "cof_std"))
    assert len(rows) >= 40
    off = cof / law(100.0, v, 1.0) - 1.0
    weak, strong = v < 60.0, v > 75.0
    for part in (weak, strong):
        assert abs(np.average(off[part], weights=std[part] ** -2)) < 0.006
    assert np.mean((off * cof / std) ** 2) < 1.5


def test_strokes_are_trials_and_pauses_and_runs_are_sessions(rng, tmp_path):
    stroke = [Part(0.4, voltage_v=80.0), LIFT]
    first = ticks([*stroke, *stroke, PAUSE, *stroke], lambda *_: 0.3, rng)
    turning = ticks([Part(0.8, voltage_v=80.0)], lambda *_: 0.3, rng)
    turning["lateral_force_n"][400:] *= -1.0
    rows = read_rows(record(tmp_path / "run.h5", first, turning), tmp_path)
    assert [row["session"] + row["trial"] for row in rows] == ["11", "12", "21", "31", "32"]
    assert all(0.0 < float(row["time_s"]) < 10.0 for row in rows)


def read_rows(path, folder):
    write_recorded([path], folder / "rows.csv")
    return rows_of(folder / "rows.csv")


def test_a_long_stroke_gives_a_row_a_second(rng, tmp_path):
    rows = read_rows(
        record(tmp_path / "run.h5", ticks([Part(4.2, voltage_v=80.0)], lambda *_: 0.3, rng)),
        tmp_path,
    )
    times = column(rows, "time_s")
    assert len(rows) == 5
    assert all(b - a <= 1.0 + 1e-6 for a, b in pairwise(times))


@pytest.mark.parametrize(
    ("column", "spoilt"),
    [
        ("voltage_v", lambda made: 80.0 * (1.0 + 0.3 * np.sin(200.0 * made["time_s"]))),
        ("frequency_hz", lambda made: np.where(made["tick"] % 90 < 45, 100.0, 110.0)),
        ("normal_force_n", lambda made: 0.5 * (1.0 + 0.5 * np.sin(30.0 * made["time_s"]))),
        ("speed_m_s", lambda made: 0.001),
        ("measured_cof", lambda made: np.nan),
        ("in_contact", lambda made: 0),
        ("flags", lambda made: int(Flag.SATURATED_SENSOR)),
        ("flags", lambda made: int(Flag.FRICTION_FROM_CURRENT)),
        ("output_on", lambda made: made["tick"] % 300 > 0),
        ("time_s", lambda made: made["time_s"] + 0.02 * (made["tick"] // 60)),
    ],
)
def test_what_is_not_steady_or_not_known_is_no_row(rng, tmp_path, column, spoilt):
    made = ticks([Part(1.0, voltage_v=80.0)], lambda *_: 0.3, rng)
    made[column] = spoilt(made)
    with refused("nothing_steady", "run.h5: no 0.1 s of sliding"):
        write_recorded([record(tmp_path / "run.h5", made)], tmp_path / "rows.csv")
    assert not (tmp_path / "rows.csv").exists()


def test_what_was_felt_around_a_gap_of_the_output_is_left_out(rng, tmp_path):
    """The voltage was gone for 0.1 s before that was noticed; it is felt 30 ms later."""
    parts = [Part(2.0, voltage_v=80.0), Part(0.1), Part(1.0, voltage_v=80.0)]
    made = ticks(parts, lambda f, v, *_: 0.3 + 0.3 * (v > 0.0), rng, wobble=0.01)
    made["voltage_v"] = 80.0
    made["output_on"] = (made["tick"] < 2100) | (made["tick"] >= 2120)
    write_recorded([record(tmp_path / "run.h5", made)], tmp_path / "rows.csv")
    rows = rows_of(tmp_path / "rows.csv")
    assert len(rows) >= 3
    np.testing.assert_allclose(column(rows, "cof"), 1.2, rtol=0.02)


def test_rows_without_a_recording_or_over_a_file_are_refused(rng, tmp_path):
    data = tmp_path / "data.csv"
    data.write_text("frequency_hz,voltage_v,normal_force_n,cof\n100,75,0.5,0.7\n")
    path = record(tmp_path / "run.h5", ticks([Part(0.5)], lambda *_: 0.3, rng))
    for paths, code in (([data], "usage"), ([path], "file_exists")):
        with refused(code):
            read_data(paths, data)
    assert data.read_text().endswith("0.7\n")


def test_a_finger_is_calibrated_from_a_recording(touch, rng, tmp_path):
    path = record(tmp_path / "run.h5", ticks(strokes(1), friction_of(touch), rng))
    said = said_by("calibrate", path, "--out", tmp_path / "finger.toml")
    for name, fitted in said["parameters"].items():
        low, high = fitted["interval_95"]
        assert low - (high - low) < touch.description.parameters[name].value < high + (high - low)
