"""Trials of known friction, loads and times, written as labs write them, come back in SI."""

from __future__ import annotations

import re
from math import sqrt
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from haptic_driver.errors import BadInputError
from haptic_driver.lab.pictures.trials import draw_trial
from haptic_driver.lab.raw_trials.cut import conditions_of, opened, tabled
from haptic_driver.lab.raw_trials.layout import Layout, text_table
from haptic_driver.lab.raw_trials.propose import proposed, roles_of
from haptic_driver.lab.raw_trials.quantities import quantities
from haptic_driver.lab.raw_trials.trial_map import Conditions, TrialMap, read_map
from model.support.units import to_si
from tests.haptic_driver.lab.raw_trials.made import (
    LOAD_N,
    MAP,
    NAMES,
    OFF_COF,
    TIME_S,
    refusal,
    rows,
    signals,
    with_keys,
    write_npz,
)
from tests.haptic_driver.lab.refusal import refused

GF_N = 9.80665e-3  # standard gravity times a gram
NAME = "a_120V_250Hz_0p5N"
BASELINE = {"start_s": -0.6, "end_s": -0.1}
PATTERNS = {
    "patterns": [r"(?P<voltage>\d+)V_(?P<frequency>\d+)Hz_(?P<normal_force>[\dp]+)N"],
    "units": {"voltage": "V", "frequency": "Hz", "normal_force": "N"},
}
TRUE = signals(noise_n=0.0)
# gf pressing negative, mN with an offset of 5 mN, volts of a monitor at 1 V per 100 V
RAW = TRUE | {"Fz": -TRUE["Fz"] / GF_N, "Fx": 1e3 * TRUE["Fx"] + 5.0, "U": 0.016 * TRUE["U"]}


def test_a_trial_gives_its_friction_load_speed_and_time(tmp_path):
    np.save(tmp_path / f"{NAME}.npy", np.rec.fromarrays(list(RAW.values()), names=",".join(NAMES)))
    said = with_keys(
        normal_force={"unit": "gf", "sign": -1},
        lateral_force={"unit": "mN", "offset": 5.0},
        voltage={"gain": 100.0, "gain_unit": "V/V"},
        motion={},
        baseline=BASELINE,
    )
    before, during = rows(tmp_path / f"{NAME}.npy", said | {"conditions": PATTERNS})
    assert (before["voltage_v"], during["voltage_v"]) == (0.0, 120.0)
    assert before["cof"] == pytest.approx(OFF_COF, rel=1e-6)
    assert during["cof"] == pytest.approx(0.6, rel=1e-6)
    assert during["normal_force_n"] == pytest.approx(LOAD_N, rel=1e-6)
    assert during["speed_m_s"] == pytest.approx(0.02, rel=1e-6)
    assert during["time_s"] == pytest.approx(0.8, abs=0.003)  # the window's middle, to a sample
    assert (during["frequency_hz"], during["commanded_normal_force_n"]) == (250.0, 0.5)


def test_a_table_without_names_goes_by_numbers(tmp_path):
    np.save(tmp_path / "t.npy", np.column_stack(list(TRUE.values())))
    numbers = {role: {"name": i + 1} for i, role in enumerate(MAP["columns"])}
    found = rows(tmp_path / "t.npy", with_keys(**numbers))
    assert found[0]["cof"] == pytest.approx(0.6, rel=1e-6)


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


@pytest.mark.parametrize(("use", "times", "more"), [("gain", 1.1, 0.0), ("offset", 1.0, 0.04)])
def test_the_trials_own_gain_or_zero_is_taken_out(tmp_path, use, times, more):
    """Friction that reads a tenth too much, or 40 mN, gives what one that reads right gives."""
    path = write_npz(tmp_path / "t.npz", TRUE | {"Fx": times * TRUE["Fx"] + more})
    (row,) = rows(path, with_keys(baseline={**BASELINE, "use": use, "cof": OFF_COF}))
    assert row["cof"] == pytest.approx(0.6, rel=1e-6)


@pytest.mark.parametrize(
    ("said", "cof"), [({}, 1.1 * OFF_COF), ({"use": "gain", "cof": OFF_COF}, OFF_COF)]
)
def test_a_trial_without_voltage_is_its_own_baseline(tmp_path, said, cof):
    """A map with [baseline], as --inspect proposes it, ended in a traceback."""
    off = 1.1 * OFF_COF * LOAD_N
    path = write_npz(tmp_path / "t.npz", TRUE | {"U": 0.0 * TIME_S, "Fx": off + 0.0 * TIME_S})
    zero = {"values": {"voltage": 0, "frequency": 0}}
    (row,) = rows(path, with_keys(conditions=zero, baseline={**BASELINE, **said}, motion={}))
    assert row["voltage_v"] == 0.0
    assert row["cof"] == pytest.approx(cof, rel=1e-6)


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
    said = Conditions(**PATTERNS, voltage_is=voltage_is, values={"waveform": waveform})
    assert conditions_of(Path(f"{NAME}.csv"), said, {})["voltage"] == pytest.approx(peak_v)


def test_conditions_from_a_table(tmp_path):
    (tmp_path / "set.csv").write_text("file,voltage,frequency,session\nb.npz,0.1,2,Monday\n")
    said = Conditions(table="set.csv", units={"voltage": "kV", "frequency": "kHz"})
    found = conditions_of(tmp_path / "b.npz", said, tabled(said, tmp_path))
    assert found == {"voltage": 100.0, "frequency": 2000.0, "session": "Monday"}
    with pytest.raises(BadInputError, match="has no row for it"):
        conditions_of(tmp_path / "c.npz", said, tabled(said, tmp_path))


ON = TRUE["U"] > 0.0


@pytest.mark.parametrize(
    ("columns", "reason"),
    [
        (TRUE | {"Fz": -TRUE["Fz"]}, "the load is -0.5 N"),
        (TRUE | {"Fx": -TRUE["Fx"]}, "friction is -"),
        (TRUE | {"U": 0.0 * TIME_S}, "voltage never exceeds"),
        (TRUE | {"x": np.where(TIME_S < 1.6, TRUE["x"], 32.0)}, "window 1, 1.302 to 2.298 s, sli"),
        (TRUE | {"t": TIME_S[::-1]}, "time does not rise at sample 2"),
        (TRUE | {"Fx": np.where(ON, np.nan, 1.0)}, "lateral_force is no number at 1"),
        (TRUE | {"Fx": TRUE["Fx"][:300]}, "columns differ in length"),
        ({"t": TIME_S}, "there is no column 'Fx'; found: t"),
    ],
)
def test_what_is_wrong_with_a_trial_is_told(tmp_path, columns, reason):
    path = write_npz(tmp_path / "t.npz", columns)
    message = refusal(path, with_keys(motion={})).message
    assert reason in message
    assert str(path) in message


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
    body = "".join(f"{5 * i},1,2,3,4\n" for i in range(12))
    (tmp_path / "t.csv").write_text(f"made at noon\n{','.join(NAMES)}\n{body}{bad}\n")
    assert re.search(f"line {line}\\b", refusal(tmp_path / "t.csv", MAP).message)


@pytest.mark.parametrize("ending", [".npz", ".npy", ".h5", ".mat"])
def test_a_file_that_is_none_of_its_kind_is_refused(tmp_path, ending):
    path = tmp_path / f"t{ending}"
    path.write_bytes(b"what is this? " * 40)
    assert refusal(path, MAP).code == "bad_trial"


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"windows": [{"start_s": 1.0, "end_s": 0.5}]}, "end_s must be above start_s"),
        ({"voltage_on": None}, "[voltage_on] is missing"),
        ({"baseline": {**BASELINE, "use": "gain"}}, "cof, friction without voltage"),
        ({"conditions": {"patterns": ["(?P<colour>.)"]}}, "needs groups"),
        ({"conditions": {"patterns": ["("]}}, "is no regular expression"),
        ({"file": {"separator": ",", "decimal": ","}}, "cannot both be a comma"),
    ],
)
def test_a_map_that_cannot_be_meant_is_refused(change: dict[str, Any], words):
    with pytest.raises(ValueError, match=re.escape(words)):
        TrialMap.model_validate(MAP | change)


def test_a_map_is_proposed_that_reads_the_file(tmp_path):
    path = tmp_path / f"day2_{NAME}_t07.txt"
    lines = [";".join(f"{x:.9g}" for x in row) for row in zip(*RAW.values(), strict=True)]
    head = "Setup;B\n\nTime;Fx;Fz;Voltage;Position\ns;mN;gf;V;mm\n"
    path.write_text(head + "\n".join(lines).replace(".", ","))
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
    columns = quantities(opened(path, said), said).columns
    np.testing.assert_allclose(columns["normal_force"], LOAD_N, rtol=1e-6)
    np.testing.assert_allclose(columns["position"], 0.02 * TIME_S, atol=1e-9)


@pytest.mark.parametrize(("unit", "written"), [("mm", set()), ("", {"position"})])
def test_a_column_of_no_unit_is_drawn_as_it_stands(unit, written, tmp_path):
    """A position without a unit was drawn as metres."""
    path = tmp_path / "t.txt"
    lines = [";".join(f"{x:.9g}" for x in row) for row in zip(*RAW.values(), strict=True)]
    head = f"Time;Fx;Fz;Voltage;Position\ns;mN;gf;V;{unit}\n"
    path.write_text(head + "\n".join(lines))
    found = proposed(path)
    assert set(found.as_written) == written
    scale = 1.0 if written else 1e-3
    np.testing.assert_allclose(found.drawn["position"], scale * [*RAW.values()][4], atol=1e-9)
    assert any("no unit" in line for line in found.taken) == bool(written)
    picture = tmp_path / "t.png"
    draw_trial("t", found.drawn, (), found.spans, picture, found.as_written)
    assert picture.stat().st_size > 0


def test_a_column_is_not_taken_against_its_unit():
    assert roles_of(["Load", "Fz"], ["mm", "N"])["normal_force"] == 1
    german = ["Zeit", "Normalkraft", "Tangentialkraft", "Weg", "Spannung"]
    known = ["time", "normal_force", "lateral_force", "position", "voltage"]
    assert roles_of(german, ["s", "N", "N", "mm", "Vpp"]) == {
        name: at for at, name in enumerate(known)
    }


def test_a_text_of_numbers_alone_has_no_names():
    content = "\n".join(["1.5;2"] * 6).encode()
    assert text_table(Path("it.csv"), content, Layout()).names == []
