"""`haptic diagnose`: the contract of its JSON, its files, and what bad data are told."""

from __future__ import annotations

import csv
import json
import shlex
from pathlib import Path

import pytest

from haptic_driver.lab.commands.diagnose import once_more
from haptic_driver.lab.measuring.plan import load_plan
from model.effects import BY_NAME
from tests.haptic_driver.commands import rows_of, said_by
from tests.reports import without_pictures

FRICTION = (
    "frequency_hz",
    "voltage_v",
    "normal_force_n",
    "speed_m_s",
    "time_s",
    "session",
    "trial",
    "cof",
    "cof_std",
)


@pytest.fixture(scope="module")
def plan(tmp_path_factory):
    plan = tmp_path_factory.mktemp("plan") / "plan.toml"
    plan.write_text(
        'name = "small"\nabout = "for a test"\nfrequency_hz = [5, 20, 80, 250]\nvoltage_v = [60,'
        " 130]\nnormal_force_n = [0.3, 0.8]\nspeed_m_s = [0.02]\nrepeats = 1\nsessions ="
        " 3\nvoltage_off_every = 4\nsettle_s = 0.2\naverage_s = 0.25\npause_s = 0.0\n"
    )
    return plan


@pytest.fixture(scope="module")
def data(plan, tmp_path_factory):
    """Friction and current on a simulated rig whose finger hides humid conduction in the gap."""
    path = tmp_path_factory.mktemp("measured") / "data.csv"
    said_by("measure", "--rig", "hidden_humidity", "--plan", plan, "--out", path)
    return path


@pytest.fixture
def unillustrated():
    with without_pictures():
        yield


def measured_friction(plan, path, seed: int) -> None:
    """Friction alone, which names less, on a rig whose finger hides a conducting insulator."""
    hide = path.with_name("hide.toml")
    hide.write_text("[johnsen_rahbek]\ninsulator_conductivity_s_per_m = 1e-9\n")
    measure = ("measure", "--rig", "simulated", "--plan", plan, "--hide", hide, "--seed", seed)
    said_by(*measure, "--out", path, "--force")
    rows = rows_of(path)
    with path.open("w", newline="") as out:
        writer = csv.DictWriter(out, FRICTION, extrasaction="ignore")
        writer.writeheader()
        writer.writerows(rows)


@pytest.fixture(scope="module")
def found(data, tmp_path_factory):
    out = tmp_path_factory.mktemp("found")
    with without_pictures():
        return out, said_by("diagnose", data, "--model", "reference", "--out", out, "--seed", 3)


def test_the_hidden_effect_is_found_or_listed(found):
    out, said = found
    assert said == said | json.loads((out / "report.json").read_text())
    assert said["seed"] == 3
    assert said["verdict"] in {"effect_found", "ambiguous"}
    listed = {e["name"] for e in said["effects"]} | {
        n for e in said["effects"] for n in e["indistinguishable_from"]
    }
    assert "humid_gap_conduction" in listed
    held = said["fit"]["held_out_chi2_per_point"]
    assert held["after"] < 0.5 * held["before"]


@pytest.mark.usefixtures("unillustrated")
@pytest.mark.soak
def test_what_to_measure_next_is_a_plan_whose_data_go_in_beside_the_first(plan, tmp_path):
    out, data, more = tmp_path / "first", tmp_path / "data.csv", tmp_path / "more.csv"
    measured_friction(plan, data, 1)
    said = said_by("diagnose", data, "--out", out)
    asked = [step for step in said["next_experiments"] if step["kind"] == "setting"]
    assert asked
    proposed = load_plan(str(out / "next_plan.toml"))
    wanted = {
        (s["frequency_hz"] or 0.0, s["voltage_v"], s["normal_force_n"], s["speed_m_s"])
        for s in asked
    }
    assert {setting[:4] for setting in proposed.settings} == wanted
    assert {setting.time_s for setting in proposed.settings} == {s.get("time_s") for s in asked}
    assert proposed.repeats == asked[0]["repeats"]
    measured_friction(out / "next_plan.toml", more, 9)
    both = said_by("diagnose", data, "--also", more, "--out", tmp_path / "both")
    assert both["data"]["rows"] == said["data"]["rows"] + len(more.read_text().splitlines()) - 1
    assert both["data"]["sessions"] == said["data"]["sessions"] + 1


def test_data_of_other_columns_do_not_go_together(haptic, data, tmp_path):
    other = tmp_path / "other.csv"
    other.write_text("frequency_hz,voltage_v,normal_force_n,cof,cof_std\n100,75,0.5,0.7,0.01\n")
    done = haptic("diagnose", data, "--also", other, "--out", tmp_path / "out")
    assert done.status == 2
    said = " ".join(done.err.split())
    assert f"{other}: has no column speed_m_s, which {data} has" in said


def test_the_model_it_writes_can_be_used(found, tmp_path):
    out, said = found
    assert said["model"] == str(out / "model.toml")
    conditions = tmp_path / "conditions.csv"
    conditions.write_text("frequency_hz,voltage_v,normal_force_n\n50,100,0.5\n")
    answers = []
    for model in (said["model"], "reference"):
        said_by("predict", "--table", conditions, "--out", tmp_path / "out.csv", "--model", model)
        answers.append(float(rows_of(tmp_path / "out.csv")[0]["cof"]))
    assert answers[0] < answers[1] - 0.01  # conduction takes force away at 50 Hz


def test_bad_rows_are_counted_in_the_report(refuses, tmp_path):
    rows = [f"{10 * (i + 1)},{50 + i},0.5,{0.55 + 0.001 * i}" for i in range(11)]
    path = tmp_path / "some.csv"
    path.write_text(
        "frequency_hz,voltage_v,normal_force_n,cof\n"
        + "\n".join([*rows, "250,75,300,0.6", "250,75,0.5,"])
    )
    command = ("diagnose", path, "--out", tmp_path / "out")
    error = refuses("bad_data", *command)
    assert "--leave-out-bad" in error["hint"]
    assert not (tmp_path / "out").exists()
    said = said_by(*command, "--leave-out-bad")
    assert (said["data"]["rows"], said["data"]["rows_left_out"]) == (11, 2)
    (told,) = [word for word in said["reasons"] if "left out" in word]
    for words in ("line 13: normal_force_n = 300", "line 14: cof is ''"):
        assert words in error["message"]
        assert words in told


def test_a_plan_is_judged_before_it_is_measured(tmp_path, monkeypatch):
    """By some effects of the catalogue, every two of which are compared; the next test asks them
    all.
    """
    names = "series_resistance amplifier_bandwidth humid_gap_conduction sweat_film"
    few = [BY_NAME[name] for name in names.split()]
    monkeypatch.setattr("model.planning.resolution.testable_effects", lambda data, on: few)
    plan = tmp_path / "small.toml"
    plan.write_text(
        'name = "small"\nfrequency_hz = [20.0, 250.0]\nvoltage_v = [75.0, 110.0]\n'
        "normal_force_n = [0.25, 0.5]\nspeed_m_s = 0.02\n"
    )
    weak = ["--strength", "-2"]  # few leave a trace: soon done
    said = said_by("diagnose", "--plan", plan, "--rig", "simulated", "--out", tmp_path, *weak)
    names = [level["name"] for level in said["levels"]]
    assert names == ["as it is", "current by a card", "full sweep"]
    seen = [
        sum(e["visible"] >= said["enough"] for e in level["effects"].values())
        for level in said["levels"]
    ]
    assert seen[0] <= seen[1] <= seen[2] > seen[0]
    assert (tmp_path / "resolution.png").read_bytes().startswith(b"\x89PNG")


def test_data_are_held_against_a_plan(tmp_path):
    """What is measured at one setting tells less than a plan of several."""
    data, plan = tmp_path / "data.csv", tmp_path / "small.toml"
    rows = [f"20,{v},0.5,0.6,0.012,0.02" for v in (0, 75)]
    data.write_text(
        "\n".join(["frequency_hz,voltage_v,normal_force_n,cof,cof_std,speed_m_s", *rows]) + "\n"
    )
    plan.write_text(
        'name = "small"\nfrequency_hz = [20.0, 250.0]\nvoltage_v = 110.0\nspeed_m_s = 0.02\n'
        "normal_force_n = [0.25, 0.5]\n"
    )
    weak = ["--strength", "-2"]
    said = said_by("diagnose", data, "--plan", plan, "--out", tmp_path, *weak)
    assert [level["name"] for level in said["levels"]][:2] == ["the data", "as it is"]
    assert said["levels"][0]["observations"] == 2
    seen = [sum(e["visible"] for e in level["effects"].values()) for level in said["levels"]]
    assert seen[0] < seen[2]


def test_what_is_printed_next_may_be_pasted(tmp_path):
    data = tmp_path / "my data.csv"
    (tmp_path / "my data.csv.meta.json").write_text('{"rig": "hidden_humidity"}')
    shown = once_more(Path("out/next_plan.toml"), [data], "reference", Path("out"))
    measure, diagnose = shown.replace("\\\n", "").split(" && ")
    to = "--plan out/next_plan.toml --out out/more.csv"
    assert shlex.join(shlex.split(measure)) == f"haptic measure --rig hidden_humidity {to}"
    asked = f"haptic diagnose '{data}' --also out/more.csv --model reference --out out"
    assert shlex.split(diagnose) == shlex.split(asked)


@pytest.mark.parametrize(("name", "rig"), [("exercise 01", "rig.toml"), ("gone", "RIG.toml")])
def test_a_rig_that_is_known_by_its_file_alone_is_proposed_by_that(tmp_path, name, rig):
    """It was proposed by a name that `--rig` does not know."""
    data = tmp_path / "data.csv"
    (tmp_path / "data.csv.meta.json").write_text(json.dumps({"rig": name}))
    (tmp_path / "rig.toml").write_text('name = "exercise 01"\n')
    shown = once_more(Path("plan.toml"), [data], "reference", Path("out"))
    named = str(tmp_path / rig) if rig == "rig.toml" else rig
    assert shlex.split(shown)[:4] == ["haptic", "measure", "--rig", named]
