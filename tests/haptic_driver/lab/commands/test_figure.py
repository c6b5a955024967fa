"""`haptic figure` as it is typed."""

import json
from pathlib import Path

import numpy as np
import pytest

from haptic_driver.lab.commands.figure import curves_of
from haptic_driver.lab.strokes.means import stroke_means
from haptic_driver.lookup.models import load_model
from model.conditions import Conditions
from model.touch_model import TouchModel
from tests.haptic_driver.commands import rows_of, said_by
from tests.haptic_driver.lab.strokes.stroke_files import data_file
from tests.haptic_driver.lab.strokes.test_means import OFF, ON, trials


@pytest.fixture
def data(tmp_path):
    return data_file(tmp_path / "data.csv", trials())


def test_pictures_and_numbers_are_written_and_said(data, tmp_path):
    said = said_by("figure", data, "--out", tmp_path / "out")
    names = ["figure-3.png", "figure-7a.png", "figure-3.csv", "figure-3-strokes.csv"]
    assert said["files"] == [str(tmp_path / "out" / name) for name in names]
    assert (said["voltage_v"], said["normal_force_n"], said["speed_m_s"]) == (75.0, 0.5, 0.02)
    assert said["steady_window_m"] == [0.015, 0.035]
    assert said["cof_off"] == pytest.approx(sum(OFF) / 3)
    low, high = said["frequencies"]
    assert (low["frequency_hz"], high["trials"]) == (50.0, 3)
    assert high["cof"] == pytest.approx(sum(ON[250.0]) / 3)
    assert high["electrostatic_force_printed_n"] == pytest.approx((1 - 0.51 / 0.64) * 0.5, rel=1e-5)
    assert rows_of(tmp_path / "out" / "figure-3.csv")[1]["cof"] == "0.64"
    curves = rows_of(tmp_path / "out" / "figure-3-strokes.csv")
    assert {row["frequency_hz"] for row in curves} == {"0.0", "50.0", "250.0"}


def test_models_are_drawn_over_the_data(data, tmp_path, haptic):
    """Two of them, the second that of a diagnosis; their values are the models'."""
    diagnosis = tmp_path / "diagnosis"
    diagnosis.mkdir()
    source = Path(__file__).parents[4] / "configs" / "models" / "table1.toml"
    (diagnosis / "model.toml").write_text(source.read_text())
    (diagnosis / "report.json").write_text(json.dumps({"effects": [{"name": "sweat_film"}]}))
    given, mended = curves_of(stroke_means(data, {}), "reference", diagnosis)
    assert (given.label, mended.label) == ("model reference", "model with sweat film")
    assert (given.frequency_hz[0], given.frequency_hz[-1]) == pytest.approx((50.0, 250.0))
    ends = Conditions(
        np.array([50.0, 250.0]), np.full(2, 75.0), np.full(2, 0.5), speed_m_s=np.full(2, 0.02)
    )
    for curve, name in ((given, "reference"), (mended, str(source))):
        expected = TouchModel(load_model(name)).predict(ends)
        assert curve.cof[[0, -1]] == pytest.approx(expected.cof)
        assert curve.force_n[[0, -1]] == pytest.approx(expected.electrostatic_force_n)
    drawn = haptic("figure", data, "--out", tmp_path / "f.svg", "--diagnosis", diagnosis)
    assert drawn.status == 0
    assert "model with sweat film" in (tmp_path / "f.svg").read_text()
    assert (tmp_path / "f-7a.svg").is_file()  # the ending says what kind of picture


def test_what_is_left_out_is_said(tmp_path, haptic):
    data = data_file(tmp_path / "d.csv", trials()[:-2])
    done = haptic("figure", data, "--out", tmp_path / "out")
    assert "left out: 250 Hz, of which there is one trial" in done.out


@pytest.mark.parametrize(
    ("arguments", "code"),
    [
        ("data.strokes.h5", "file_unreadable"),
        ("data.csv --voltage 60", "no_such_condition"),
        ("data.csv --diagnosis .", "no_diagnosis"),
    ],
)
@pytest.mark.usefixtures("data")
def test_what_cannot_be_drawn_is_an_error_and_nothing_is_written(
    tmp_path, monkeypatch, refuses, arguments, code
):
    monkeypatch.chdir(tmp_path)
    before = set(tmp_path.iterdir())
    refuses(code, "figure", *arguments.split())
    assert set(tmp_path.iterdir()) == before


def test_measure_draws_it_when_asked(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("p.toml").write_text(
        'name = "p"\nfrequency_hz = [50.0, 250.0]\nvoltage_v = 75.0\nnormal_force_n = 0.5\n'
        "speed_m_s = 0.02\nrepeats = 2\nvoltage_off_every = 2\naverage_s = 0.5\npause_s = 0.1\n"
    )
    said = said_by("measure", "--plan", "p.toml", "--out", "data.csv", "--figure")
    assert said["strokes"] == "data.strokes.h5"
    assert said["files"][0] == "data-figure-3.png"
    assert all(Path(name).is_file() for name in said["files"])
    rows = rows_of(Path("data-figure-3.csv"))
    assert [row["trials"] for row in rows] == ["2", "2"]
    again = said_by("figure", "data.csv", "--out", "figures")
    assert [row["cof"] for row in again["frequencies"]] == [float(row["cof"]) for row in rows]
