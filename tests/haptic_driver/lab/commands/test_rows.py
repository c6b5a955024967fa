"""`haptic rows` on the made folder of raw trials, as the page on one's own data has it."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from model.diagnosis.data import read_measurements
from tests.docs import own_data
from tests.haptic_driver.commands import rows_of, said_by

PAGE = Path(__file__).resolve().parents[4] / "docs" / "own-data.md"
TRIALS = 72


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("lab")
    own_data.write(folder / "trials")
    (folder / "map.toml").write_text(own_data.map_of(PAGE), encoding="utf-8")
    return folder


def command(folder: Path, *trials: Path, out: str) -> list[object]:
    return ["rows", *trials, "--map", folder / "map.toml", "--out", folder / out]


@pytest.fixture(scope="module")
def made(folder):
    return said_by(*command(folder, folder / "trials", out="data.csv"), "--leave-out-bad")


def test_a_bad_file_refuses_all_unless_it_is_left_out(folder, haptic, made):
    last = (folder / "trials").glob("*_t7*.csv")
    refused = haptic(*command(folder, *last, out="none.csv"), "--json")
    assert refused.status == 2
    assert "_t71.csv: window 1" in refused.said["error"]["message"]
    assert "--leave-out-bad" in refused.said["error"]["hint"]
    assert not (folder / "none.csv").exists()
    assert (made["trials"], made["settings"], made["sessions"]) == (TRIALS - 1, 24, 3)
    (left,) = made["left_out"]
    assert left["file"].endswith("_t71.csv")
    assert Path(made["picture"]).read_bytes().startswith(b"\x89PNG")


def test_the_rows_hold_measured_loads_and_the_friction_of_the_finger(folder, made):
    rows = rows_of(folder / "data.csv")
    assert read_measurements(folder / "data.csv").rows == len(rows) == TRIALS - 1
    loads = {row["normal_force_n"] for row in rows if row["commanded_normal_force_n"] == "0.3"}
    assert len(loads) > 30
    for row in rows[::10]:
        load_n = float(row["normal_force_n"])
        true = own_data.cof(float(row["frequency_hz"]), float(row["voltage_v"]), load_n)
        # noise of 250 Hz samples over 1 s and over the 0.7 s before, twice each: four sigma
        assert float(row["cof"]) == pytest.approx(true, rel=4.0 * own_data.NOISE / math.sqrt(100))


def test_looking_draws_and_writes_no_rows(folder, tmp_path):
    out = tmp_path / "data.csv"
    said_by("rows", folder / "trials", "--map", folder / "map.toml", "--look", "--out", out)
    assert (tmp_path / "data-trial.png").exists()
    assert not out.exists()


def test_units_of_the_map_are_refused_before_anything_is_read(folder, tmp_path, refuses):
    bad = tmp_path / "map.toml"
    text = (folder / "map.toml").read_text(encoding="utf-8")
    bad.write_text(text.replace('frequency = "Hz"', 'frequency = "rpm"'), encoding="utf-8")
    error = refuses("unknown_unit", "rows", folder / "trials", "--map", bad)
    assert "conditions.units.frequency: rpm" in error["message"]


def test_what_is_missing_is_told(folder, refuses):
    refuses("usage", "rows")
    refuses("file_not_found", "rows", "nowhere", "--map", folder / "map.toml")
