"""Trials of known friction, loads and times, written as labs write them, come back in SI."""

from __future__ import annotations

import re
from math import sqrt
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from haptic_driver.errors import BadInputError
from haptic_driver.lab.raw_trials.cut import (
    Row,
    conditions_of,
    opened,
    read_trials,
    rows_of,
    tabled,
)
from haptic_driver.lab.raw_trials.propose import proposed, roles_of
from haptic_driver.lab.raw_trials.quantities import quantities
from haptic_driver.lab.raw_trials.trial_map import TrialMap, read_map
from model.support.layout import Layout, text_table
from model.support.units import to_si
from tests.haptic_driver.lab.refusal import refused

GF_N = 9.80665e-3  # standard gravity times a gram
TIME_S = np.arange(400) / 200.0
ON = (TIME_S >= 0.8) & (TIME_S < 1.6)
LOAD_N, OFF_COF, ON_COF = 0.5, 0.4, 0.6
LATERAL_N = LOAD_N * np.where(ON, ON_COF, OFF_COF)
POSITION_M = 0.03 * TIME_S
# ms, gf pressing negative, mN with an offset of 5 mN, volts of a monitor at 1 V per 100 V, mm
RAW = np.column_stack(
    [
        1e3 * TIME_S,
        np.full(TIME_S.size, -LOAD_N / GF_N),
        1e3 * LATERAL_N + 5.0,
        np.where(ON, 1.2, 0.0),
        1e3 * POSITION_M,
    ]
)
MAP: dict[str, Any] = {
    "columns": {
        "time": {"name": "t", "unit": "ms"},
        "normal_force": {"name": "Fz", "unit": "gf", "sign": -1},
        "lateral_force": {"name": "Fx", "unit": "mN", "offset": 5.0},
        "voltage": {"name": "HV", "unit": "V", "gain": 100.0, "gain_unit": "V/V"},
        "position": {"name": "x", "unit": "mm"},
    },
    "conditions": {
        "patterns": [r"(?P<voltage>\d+)V_(?P<frequency>\d+)Hz_(?P<normal_force>[\dp]+)N"],
        "units": {"voltage": "V", "frequency": "Hz", "normal_force": "N"},
    },
    "voltage_on": {"column": "voltage"},
    "motion": {},
    "windows": [{"start_s": 0.2, "end_s": 0.7}],
    "baseline": {"start_s": -0.6, "end_s": -0.1},
}
NAME = "a_120V_250Hz_0p5N"


def made(**changes: Any) -> TrialMap:
    return TrialMap.model_validate(MAP | changes)


def text(separator: str, decimal: str, header: str) -> str:
    lines = [separator.join(f"{x:.9g}".replace(".", decimal) for x in row) for row in RAW]
    return header + "\n".join(lines) + "\n"


def rows(path: Path, said: TrialMap) -> list[Row]:
    conditions = conditions_of(path, said.conditions, {})
    (trial,) = read_trials(opened(path, said), said, conditions)
    return rows_of(trial, said, 1)


def read_columns(path: Path, said: TrialMap) -> dict[str, np.ndarray]:
    return dict(quantities(opened(path, said), said).columns)


def write_npz(path: Path, raw: np.ndarray = RAW) -> None:
    np.savez(path, **dict(zip(("t", "Fz", "Fx", "HV", "x"), raw.T, strict=True)))


def write_records(path: Path) -> None:
    names = ("t", "Fz", "Fx", "HV", "x")
    np.save(path, np.rec.fromarrays(list(RAW.T), names=",".join(names)))


WRITERS = [(".npz", write_npz), (".npy", write_records)]


@pytest.mark.parametrize(("ending", "write"), WRITERS, ids=[ending for ending, _ in WRITERS])
def test_a_trial_gives_its_friction_load_speed_and_time(tmp_path, ending, write):
    path = tmp_path / f"{NAME}{ending}"
    write(path)
    before, during = rows(path, made())
    assert (before["voltage_v"], during["voltage_v"]) == (0.0, 120.0)
    assert before["cof"] == pytest.approx(OFF_COF, rel=1e-6)
    assert during["cof"] == pytest.approx(ON_COF, rel=1e-6)
    assert during["normal_force_n"] == pytest.approx(LOAD_N, rel=1e-6)
    assert during["speed_m_s"] == pytest.approx(0.03, rel=1e-6)
    assert during["time_s"] == pytest.approx(0.45, abs=0.003)  # the window's middle, to a sample
    assert (during["frequency_hz"], during["commanded_normal_force_n"]) == (250.0, 0.5)


def test_a_tdms_file(tmp_path):
    nptdms = pytest.importorskip("nptdms")
    path = tmp_path / f"{NAME}.tdms"
    with nptdms.TdmsWriter(path) as writer:
        units = ("ms", "gf", "mN", "V", "mm")
        for name, unit, values in zip(("t", "Fz", "Fx", "HV", "x"), units, RAW.T, strict=True):
            said = {"unit_string": unit}
            writer.write_segment([nptdms.ChannelObject("raw", name, values, properties=said)])
    columns = {
        role: {key: f"raw/{value}" if key == "name" else value for key, value in column.items()}
        | {"unit": None}
        for role, column in MAP["columns"].items()
    }
    _, during = rows(path, made(columns=columns))
    assert during["cof"] == pytest.approx(ON_COF, rel=1e-6)


def test_a_table_without_names_goes_by_numbers(tmp_path):
    path = tmp_path / f"{NAME}.npy"
    np.save(path, RAW)
    order = ("time", "normal_force", "lateral_force", "voltage", "position")
    columns = {role: MAP["columns"][role] | {"name": i + 1} for i, role in enumerate(order)}
    assert rows(path, made(columns=columns))[1]["cof"] == pytest.approx(ON_COF, rel=1e-6)


@pytest.mark.parametrize(
    ("quantity", "unit", "gain_unit", "factor"),
    [
        ("time", "µs", "", 1e-6),
        ("normal_force", "gf", "", GF_N),
        ("lateral_force", "Newton", "", 1.0),
        ("lateral_force", "mV", "N/V", 1e-3),
        ("voltage", "mV p-p", "", 0.5e-3),
        ("voltage", "Vrms", "", sqrt(2.0)),
        ("voltage", "V peak", "", 1.0),
        ("voltage", "100 V", "", 100.0),
        ("time", "10 ms", "", 0.01),
    ],
)
def test_units(quantity, unit, gain_unit, factor):
    assert to_si(quantity, unit, "here", gain_unit) == pytest.approx(factor, rel=1e-12)


@pytest.mark.parametrize(
    ("quantity", "unit"),
    [
        ("normal_force", "g"),
        ("normal_force", "furlongish"),
        ("frequency", "rpm"),
        ("lateral_force", "V"),
        ("voltage_offset", "Vpp"),
        ("time", "__import__('os')"),
    ],
)
def test_a_unit_that_is_not_understood_is_refused_by_name(quantity, unit):
    with refused("unknown_unit", unit, "columns.it"):
        to_si(quantity, unit, "columns.it")


@pytest.mark.parametrize(("use", "times", "more"), [("gain", 1.1, -0.5), ("offset", 1.0, 40.0)])
def test_the_trials_own_gain_or_zero_is_taken_out(tmp_path, use, times, more):
    """Friction that reads a tenth too much, or 40 mN, gives what one that reads right gives."""
    path = tmp_path / f"{NAME}.npz"
    raw = RAW.copy()
    raw[:, 2] = times * raw[:, 2] + more  # a gain turns about the offset of 5 mN
    write_npz(path, raw)
    (row,) = rows(path, made(baseline=MAP["baseline"] | {"use": use, "cof": OFF_COF}))
    assert row["cof"] == pytest.approx(ON_COF, rel=1e-6)


@pytest.mark.parametrize(
    ("voltage_is", "waveform", "peak_v"),
    [
        ("peak", "sine", 120.0),
        ("peak_to_peak", "sine", 60.0),
        ("rms", "sine", 120.0 * sqrt(2.0)),
        ("rms", "square", 120.0),
    ],
)
def test_a_set_voltage_becomes_the_amplitude(voltage_is, waveform, peak_v):
    said = MAP["conditions"] | {"voltage_is": voltage_is, "values": {"waveform": waveform}}
    found = conditions_of(Path(f"{NAME}.csv"), made(conditions=said).conditions, {})
    assert found["voltage"] == pytest.approx(peak_v)


def test_conditions_from_a_table(tmp_path):
    (tmp_path / "set.csv").write_text("file,voltage,frequency,session\nb.npz,0.1,2,Monday\n")
    said = {"table": "set.csv", "units": {"voltage": "kV", "frequency": "kHz"}}
    conditions = made(conditions=said).conditions
    found = conditions_of(tmp_path / "b.npz", conditions, tabled(conditions, tmp_path))
    assert found == {"voltage": 100.0, "frequency": 2000.0, "session": "Monday"}
    with pytest.raises(BadInputError, match="has no row for it"):
        conditions_of(tmp_path / "c.npz", conditions, tabled(conditions, tmp_path))


def changed(**columns: Any) -> dict[str, np.ndarray]:
    return dict(zip(("t", "Fz", "Fx", "HV", "x"), RAW.T, strict=True)) | columns


@pytest.mark.parametrize(
    ("columns", "reason"),
    [
        (changed(Fz=-RAW[:, 1]), "the load is -0.5 N"),
        (changed(Fx=-RAW[:, 2]), "friction is -"),
        (changed(HV=np.zeros(400)), "voltage never exceeds"),
        (changed(x=np.where(TIME_S < 1.2, RAW[:, 4], 36.0)), "window 1, 1 to 1.5 s, slides for"),
        (changed(t=RAW[::-1, 0]), "time does not rise at sample 2"),
        (changed(Fx=np.where(ON, np.nan, 1.0)), "lateral_force is no number at 1 s"),
        (changed(Fx=RAW[:300, 2]), "columns differ in length"),
        (changed(Fx=np.where(TIME_S == 1.1, 99.0, RAW[:, 2])), "lateral_force is 99 at 1.1 s"),
        ({"t": RAW[:, 0]}, "there is no column 'Fx'; found: t"),
    ],
)
def test_what_is_wrong_with_a_trial_is_told(tmp_path, columns, reason):
    path = tmp_path / f"{NAME}.npz"
    np.savez(path, **columns)
    with pytest.raises(BadInputError) as caught:
        rows(path, made())
    assert reason in caught.value.message
    assert str(path) in caught.value.message


@pytest.mark.parametrize(
    ("bad", "line"),
    [
        ("60,1,2,3,high", 15),
        ("\n60,1,2,3,high", 16),
        ("60,1,2", 15),
        ("60,1,2,3,4,5", 15),
        ("late,1,2,3,4", 15),
    ],
)
def test_a_line_that_is_no_row_of_numbers_is_named(tmp_path, bad, line):
    path = tmp_path / f"{NAME}.csv"
    body = "".join(f"{5 * i},1,2,3,4\n" for i in range(12))
    path.write_text(f"made at noon\nt,Fz,Fx,HV,x\n{body}{bad}\n")
    with pytest.raises(BadInputError, match=f"line {line}\\b"):
        read_columns(path, made())


@pytest.mark.parametrize("ending", [".npz", ".npy", ".h5", ".mat"])
def test_a_file_that_is_none_of_its_kind_is_refused(tmp_path, ending):
    path = tmp_path / f"{NAME}{ending}"
    path.write_bytes(b"what is this? " * 40)
    with refused("bad_trial"):
        read_columns(path, made())


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"windows": [{"start_s": 1.0, "end_s": 0.5}]}, "end_s must be above start_s"),
        ({"voltage_on": None}, "[voltage_on] is missing"),
        ({"baseline": MAP["baseline"] | {"use": "gain"}}, "cof, friction without voltage"),
        ({"conditions": {"patterns": ["(?P<colour>.)"]}}, "needs groups"),
        ({"conditions": {"patterns": ["("]}}, "is no regular expression"),
        ({"file": {"separator": ",", "decimal": ","}}, "cannot both be a comma"),
    ],
)
def test_a_map_that_cannot_be_meant_is_refused(change, words):
    with pytest.raises(ValueError, match=re.escape(words)):
        made(**change)


def test_a_map_is_proposed_that_reads_the_file(tmp_path):
    path = tmp_path / f"day2_{NAME}_t07.txt"
    path.write_text(text(";", ",", "Setup;B\n\nTime;Fz;Fx;Voltage;Position\nms;gf;mN;V;mm\n"))
    target = tmp_path / "map.toml"
    text_of_map = proposed(path).map_text
    assert re.findall(r"(\w+) = .TODO", text_of_map) == ["voltage_is"]
    target.write_text(text_of_map.replace("TODO", "peak"))
    said = read_map(target)
    assert (said.file.separator, said.file.units_row) == (";", True)
    assert said.columns.normal_force is not None
    assert (said.columns.normal_force.name, said.columns.normal_force.sign) == ("Fz", -1)
    conditions = conditions_of(path, said.conditions, {})
    expected = {"voltage": 120.0, "frequency": 250.0, "normal_force": 0.5}
    assert conditions == expected | {"session": "2", "trial": "07"}
    columns = read_columns(path, said)
    np.testing.assert_allclose(columns["normal_force"], LOAD_N, rtol=1e-6)
    np.testing.assert_allclose(columns["position"], POSITION_M, atol=1e-9)


def test_a_column_is_not_taken_against_its_unit():
    assert roles_of(["Load", "Fz"], ["mm", "N"])["normal_force"] == 1


def test_a_text_of_numbers_alone_has_no_names():
    content = "\n".join(["1.5;2"] * 6).encode()
    assert text_table(Path("it.csv"), content, Layout()).names == []
