"""`haptic exercise`: what is hidden stands in nothing that a student sees, the simulator has it all
the same, and answers by hand get the marks that the rules say.
"""

import base64
import json
import stat
import zlib

import numpy as np
import pytest

from haptic_driver.lab.measuring.benches import carried_out
from haptic_driver.lookup.models import load_model
from haptic_driver.rig.config import load_rig
from haptic_driver.rig.sealed import opened, seal
from haptic_driver.simulation.finger_model import finger_of, with_hidden
from model.conditions import Conditions
from model.effects import BY_NAME
from model.touch_model import TouchModel
from tests.haptic_driver.commands import rows_of, said_by
from tests.haptic_driver.lab.refusal import refused

SEED = 2718281  # something is hidden from the first two students
PLAN = """
name = "small"
normal_force_n = 0.5
speed_m_s = 0.02
voltage_off_every = 4
[[points]]
frequency_hz = [10.0, 250.0]
voltage_v = [60.0, 100.0]
speed_m_s = [0.01, 0.04]
"""


@pytest.fixture(scope="module")
def plan(tmp_path_factory):
    path = tmp_path_factory.mktemp("plan") / "small.toml"
    path.write_text(PLAN)
    return path


def make(folder, plan, students=2):
    said_by("exercise", "make", folder, "--seed", SEED, "--students", students, "--plan", plan)
    return folder


@pytest.fixture(scope="module")
def course(tmp_path_factory, plan):
    return make(tmp_path_factory.mktemp("exercise") / "course", plan)


@pytest.fixture(scope="module")
def key(course):
    return json.loads((course / "key.json").read_text())


def shown_in(content):
    """Names of effects; `limits.series_resistance_ohm` is the rig's own."""
    content = content.replace(b"series_resistance_ohm", b"")
    return [name for name in BY_NAME if name.encode() in content]


def test_what_is_hidden_stands_in_nothing_that_a_student_sees(course, key, plan, haptic, tmp_path):
    assert all(student["hide"] for student in key["students"].values())
    home = course / "students" / "01"
    rig = home / "rig.toml"
    trace = ["time_s,position_m,normal_force_n", *(f"{t / 100},{t / 2500},0.5" for t in range(60))]
    (tmp_path / "trace.csv").write_text("\n".join(trace) + "\n")
    said = [
        haptic("doctor", "--rig", rig, "--json"),
        haptic("demo", "--rig", rig, "--trace", tmp_path / "trace.csv", "--out", home / "demo"),
        haptic("measure", "--rig", rig, "--plan", plan, "--out", home / "more.csv", "--json"),
        haptic("exercise", "--help"),
    ]
    assert [one.status for one in said] == [0] * len(said)
    # as a recording and a twin's file have it
    (home / "config.json").write_text(json.dumps(load_rig(str(rig)).model_dump(mode="json")))
    files = {p: p.read_bytes() for p in (course / "students").rglob("*") if p.is_file()}
    seen = {"rig.toml", "data.csv", "README.md", "more.csv", "more.strokes.h5", "friction.png"}
    assert seen <= {path.name for path in files}
    printed = {i: (one.out + one.err).encode() for i, one in enumerate(said)}
    assert [name for name, content in (files | printed).items() if shown_in(content)] == []
    assert str(SEED).encode() not in b"".join(files.values())
    assert stat.S_IMODE((course / "key.json").stat().st_mode) == 0o600
    assert shown_in((course / "key.json").read_bytes())


def off(rows, touch):
    """Root mean square of the residuals in standard deviations, for any gain of the session."""
    columns = ("frequency_hz", "voltage_v", "normal_force_n", "speed_m_s", "cof", "cof_std")
    f, v, n, s, cof, std = np.array([[float(row[c]) for c in columns] for row in rows]).T
    ratio = np.log(cof / touch.cof(Conditions(f, v, n, speed_m_s=s)))
    return np.sqrt(np.mean(((ratio - ratio.mean()) / (std / cof)) ** 2))


def test_the_data_are_those_of_the_finger_in_the_key_and_not_of_the_model(course, key):
    reference = load_model("reference")
    for name, student in key["students"].items():
        rows = rows_of(course / "students" / name / "data.csv")
        finger = TouchModel(reference.with_values(**student["finger"]))
        assert off(rows, with_hidden(finger, student["hide"])) < 2.0 < off(rows, finger)


def test_the_same_seed_makes_the_same_for_more_students_too(course, key, plan, tmp_path):
    again = make(tmp_path / "again", plan, students=3)
    for path in course.rglob("0*/*"):
        if path.name in ("rig.toml", "README.md"):
            assert (again / path.relative_to(course)).read_bytes() == path.read_bytes()
    data = "students/02/data.csv"
    assert (again / data).read_bytes() == (course / data).read_bytes()
    more = json.loads((again / "key.json").read_text())["students"]
    assert {name: more[name] for name in key["students"]} == key["students"]


def test_an_intervention_takes_away_what_is_sealed_too(course):
    config = load_rig(str(course / "students" / "01" / "rig.toml"))
    (name,) = opened(config.simulation.sealed).hide
    (intervention,) = BY_NAME[name].removed_by
    left = carried_out(config, intervention).simulation
    assert opened(left.sealed).hide == {}
    finger = finger_of(TouchModel(load_model("reference")), left).description
    assert finger.effect_parameters == load_model("reference").effect_parameters
    assert finger.values.cof_off == opened(config.simulation.sealed).finger["cof_off"]


@pytest.mark.parametrize("alter", [lambda s: s[:-8], lambda s: s[:20] + s[21:], lambda s: "!" + s])
def test_a_sealed_text_that_was_altered_is_refused(course, tmp_path, alter):
    text = (course / "students" / "01" / "rig.toml").read_text()
    sealed = text.partition('sealed = "')[2].partition('"')[0]
    (tmp_path / "rig.toml").write_text(text.replace(sealed, alter(sealed)))
    with refused("bad_config", "simulation.sealed: is not as `haptic exercise make` wrote it"):
        load_rig(str(tmp_path / "rig.toml"))


def test_a_word_that_unpacks_without_end_is_refused():
    bomb = base64.urlsafe_b64encode(zlib.compress(b" " * 50_000_000)).decode()
    with pytest.raises(ValueError, match="haptic exercise make"):
        opened(bomb)
    assert seal(opened("")) == ""


def test_a_folder_with_something_in_it_is_left_alone(tmp_path, refuses):
    (tmp_path / "mine").write_text("")
    for folder in (tmp_path, tmp_path / "mine"):
        error = refuses("file_exists", "exercise", "make", folder, "--seed", 1)
        assert str(folder) in error["message"]
    assert [path.name for path in tmp_path.iterdir()] == ["mine"]


GAIN, GAP = {"drive_gain_error": {"gain": 0.8}}, {"sweat_film": {"share": 0.1}}
KEY = {"01": GAIN, "02": GAIN, "03": GAIN, "04": {}, "05": {}, "06": GAP, "07": GAP, "08": GAP}
ANSWERS = {
    "01": {"verdict": "named", "effects": ["drive_gain_error"], "probability": 0.9},
    "02": {"verdict": "listed", "effects": ["sweat_film", "drive_gain_error"]},
    "03": {"verdict": "nothing"},
    "04": {"verdict": "nothing", "where": []},
    "05": {"verdict": "listed", "effects": ["sweat_film"]},
    "06": {"verdict": "unknown"},
    "07": {"verdict": "named", "effects": ["drive_gain_error"]},
}


@pytest.fixture
def marked(tmp_path):
    students = {name: {"hide": hide, "finger": {}} for name, hide in KEY.items()}
    key = {"seed": 1, "plan": "course", "students": students}
    (tmp_path / "key.json").write_text(json.dumps(key))
    for name, answer in ANSWERS.items():
        (tmp_path / f"{name}.json").write_text(json.dumps({name: answer}))
    return tmp_path


def test_answers_by_hand_are_marked(marked, haptic):
    files = [marked / f"{name}.json" for name in ANSWERS]
    found = said_by("exercise", "score", marked, *files)
    assert {
        name: (student["mark"], student["right"]) for name, student in found["students"].items()
    } == {
        "01": ("named", True),
        "02": ("in the list", True),
        "03": ("overlooked", False),
        "04": ("nothing hidden", True),
        "05": ("not in the list", False),
        "06": ("left without a name", False),
        "07": ("wrong name", False),
        "08": ("no answer", False),
    }
    assert found["right"] == 3
    names = found["total"]["names"]
    assert names["single_named"] == {"count": 1, "of": 5}
    assert names["wrong_name"] == {"count": 1, "of": 7}
    assert names["nothing_named"] == {"count": 1, "of": 2}
    assert found["total"]["calibration"]["error"] == pytest.approx(0.1)
    done = haptic("exercise", "score", marked, *files)
    assert "right 3 of 8; wrong names 1" in done.out
    assert sum(line.startswith("│ 0") for line in done.out.splitlines()) == 8


def test_one_answer_that_cannot_be_read_keeps_no_mark_from_the_others(marked, haptic):
    (marked / "bad.json").write_text('{"4": {"verdict": "nothing"}}')
    done = haptic("exercise", "score", marked, marked / "01.json", marked / "bad.json")
    assert done.status == 0
    assert "right 1 of 8" in done.out
    assert f"left out: {marked}/bad.json" in "".join(done.out.splitlines())


def test_what_cannot_be_marked_is_refused(marked, refuses):
    first = marked / "01.json"
    twice = refuses("bad_answers", "exercise", "score", marked, first, first)
    assert "student 01 has answered in another file too" in twice["message"]
    (marked / "key.json").write_text("{")
    assert "key.json" in refuses("bad_key", "exercise", "score", marked, first)["message"]
