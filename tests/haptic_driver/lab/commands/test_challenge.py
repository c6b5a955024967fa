"""`haptic challenge`: a folder without labels, answers by hand, what is refused, and the scores."""

import json
import re
import shutil
from pathlib import Path

import pytest

from haptic_driver.errors import HapticError
from haptic_driver.lab.challenge.answers import read_answers
from haptic_driver.lab.challenge.own import write_answers
from haptic_driver.lab.challenge.sets import generator
from model.effects import BY_NAME
from tests.haptic_driver.commands import rows_of, said_by
from tests.haptic_driver.lab.refusal import refused

# its three small sets: an effect of the catalogue, nothing, and something of no catalogue
SEED = 339
RIGHT = {
    "001.csv": {"verdict": "named", "effects": ["skin_hydration"], "probability": 0.9},
    "002.csv": {"verdict": "nothing", "where": []},
    "003.csv": {"verdict": "unknown"},
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("challenge") / "sets-of-three"
    said_by("challenge", "make", folder, "--seed", SEED, "--sets", 3, "--friction")
    return folder


def written(path: Path, answers: object) -> Path:
    path.write_text(json.dumps(answers))
    return path


def test_a_folder_has_sets_a_data_sheet_and_no_label(folder):
    files = {str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file()}
    names = {f"{kind}/{name}" for name in RIGHT for kind in ("sets", "unseen")}
    assert files == {"README.md", "challenge.json"} | names
    about = json.loads((folder / "challenge.json").read_text())
    assert set(about) == {"seed", "friction_alone", "files"}
    sheet = (folder / "README.md").read_text()
    for name in names:
        assert all(f"`{column}`" in sheet for column in rows_of(folder / name)[0])
    for effect, kind in BY_NAME.items():
        assert f"- `{effect}`: {kind.physics}\n" in sheet


def test_the_answer_on_the_data_sheet_is_read(folder, tmp_path):
    (shown,) = re.findall(r"```json\n(.*?)```", (folder / "README.md").read_text(), re.DOTALL)
    path = tmp_path / "shown.json"
    path.write_text(shown)
    columns = dict.fromkeys(json.loads(shown), ("voltage_v", "frequency_hz"))
    assert read_answers(path, columns)["002.csv"].verdict == "listed"


def test_a_set_is_the_same_however_many_are_made(folder, tmp_path):
    said_by("challenge", "make", tmp_path / "c", "--seed", SEED, "--sets", 1, "--friction")
    one, same = (path / "sets" / "001.csv" for path in (folder, tmp_path / "c"))
    assert one.read_bytes() == same.read_bytes()


def test_answers_by_hand_are_scored_and_shown(folder, tmp_path, haptic):
    command = ("challenge", "score", folder, written(tmp_path / "a.json", RIGHT))
    found = said_by(*command)
    once = {"count": 1, "of": 1}
    assert found["names"]["single_named"] == found["names"]["outside_unknown"] == once
    assert found["names"]["wrong_name"] == {"count": 0, "of": 3}
    assert found["names"]["nothing_named"] == {"count": 0, "of": 1}
    assert found["place"] == {"f1": None, "sets": 0, "invented": {"count": 0, "of": 1}}
    assert found["calibration"]["error"] == pytest.approx(0.1)
    assert found["answered"] == {
        "verdict": 3,
        "probability": 1,
        "where": 1,
        "strength": 0,
        "finger": 0,
        "predicted": 0,
    }
    shown = haptic(*command).out
    line = next(line for line in shown.splitlines() if "a name or a list" in line)
    assert [cell.strip() for cell in line.strip("│").split("│")][1:] == ["0", "1"]
    assert "answered of 3 sets: verdict 3, probability 1" in shown


def test_rows_of_a_sweep_have_no_place(tmp_path):
    """A set with the electrode's witnesses, in which nothing is hidden; 5 V are those of sweeps."""
    folder = tmp_path / "c"
    said_by("challenge", "make", folder, "--seed", 7, "--sets", 1)
    rows = rows_of(folder / "sets" / "001.csv")
    assert {row["cof"] == "" for row in rows if row["voltage_v"] == "5"} == {True}
    answers = {"001.csv": {"where": [{"voltage_v": [5, 5]}], "strength": 0.0}}
    found = said_by("challenge", "score", folder, written(tmp_path / "a.json", answers))
    assert found["place"]["invented"] == {"count": 0, "of": 1}


NAMED = {"verdict": "named", "effects": ["skin_hydration"]}
REFUSED = [
    ({"01.csv": {}}, "no set '01.csv'", "'001.csv'"),
    ({"001.csv": NAMED | {"effects": ["skin_hydratoin"]}}, "'skin_hydratoin'", "'skin_hydration'"),
    ({"001.csv": NAMED | {"probability": 1.2}}, "001.csv: probability", "'probability'"),
    ({"001.csv": {"verdict": "named"}}, "001.csv: verdict named with 0 effects", "named"),
    ({"001.csv": NAMED | {"verdict": "nothing"}}, "verdict nothing with 1 effects", "named"),
    ({"001.csv": {"where": [{"cof": [0, 1]}]}}, "'cof'", "voltage_v"),
    ({"001.csv": {"where": [{"voltage_v": [9, 1]}]}}, "from 9 to 1 is empty", "[low, high]"),
    ({"001.csv": {"finger": {"area": [1e-4, 1e-5]}}}, "a finger has no 'area'", "contact_area_m2"),
    ({"001.csv": {"predicted": [0.5] * 23}}, "001.csv: predicted", "predicted"),
    ({"001.csv": {"finger": {"cof_off": [0.5, 0.0]}}}, "001.csv: finger.cof_off", "cof_off"),
    ([], "no object", '{"001.csv"'),
]


@pytest.mark.parametrize(("answers", "said", "hint"), REFUSED)
def test_an_answer_that_cannot_be_one_is_refused(folder, tmp_path, answers, said, hint):
    columns = {name: rows_of(folder / "sets" / name)[0] for name in RIGHT}
    with refused("bad_answers", said, hint=hint):
        read_answers(written(tmp_path / "a.json", answers), columns)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("{'001.csv'", "cannot be read"),
        ('{"001.csv": {}, "002.csv": {}, "001.csv": {}}', "'001.csv' stands there twice"),
        ('{"001.csv": {"probability": NaN}}', "001.csv: probability"),
        ('{"001.csv": {"strength": -1}}', "001.csv: strength"),
    ],
)
def test_what_is_no_answer_is_refused(folder, tmp_path, refuses, text, said):
    (tmp_path / "a.json").write_text(text)
    error = refuses("bad_answers", "challenge", "score", folder, tmp_path / "a.json")
    assert said in error["message"]


@pytest.mark.parametrize(
    ("name", "before", "after", "code"),
    [
        ("sets/002.csv", ",", ";", "changed_set"),
        # as if another version of the generator had made the sets
        ("challenge.json", f'"seed": {SEED}', '"seed": 7', "another_generator"),
        ("challenge.json", '"seed"', '"sead"', "bad_challenge"),
        ("challenge.json", "{", "", "bad_challenge"),
    ],
)
def test_a_folder_that_is_not_as_made_is_refused(
    folder, tmp_path, haptic, name, before, after, code
):
    other = tmp_path / "c"
    shutil.copytree(folder, other)
    text = (other / name).read_text()
    assert before in text
    (other / name).write_text(text.replace(before, after, 1))
    done = haptic("challenge", "score", other, written(tmp_path / "a.json", {}), "--json")
    error = done.said["error"]
    assert error["code"] == code
    assert code != "changed_set" or "002.csv" in error["message"]


def test_a_challenge_is_not_overwritten(folder, refuses):
    refuses("file_exists", "challenge", "make", folder, "--seed", 1)


def test_an_installation_without_the_test_tree_says_so(tmp_path):
    with refused("no_test_tree", "made by the test tree", hint="clone", kind=HapticError):
        generator(tmp_path)


def test_the_program_answers_what_is_not_answered_yet(folder, tmp_path):
    path = written(tmp_path / "a.json", {name: RIGHT[name] for name in ("002.csv", "003.csv")})
    done = said_by("challenge", "answer", folder, "--out", path)
    assert (done["answers"], done["kept"]) == (3, 2)
    said = json.loads(path.read_text())
    assert said["003.csv"] == {"verdict": "unknown"}
    found = said["001.csv"]
    assert found["verdict"] in ("named", "listed")
    assert "skin_hydration" in found["effects"]
    assert 0.5 < found["probability"] <= 1.0
    assert found["where"]
    assert found["strength"] > 0.0
    proof = said_by("challenge", "score", folder, path)["proof"]
    assert (proof["sets"], proof["visible"]) == (1, 1)
    assert proof["share"] > 0.8  # of the change that its hidden hydration makes elsewhere
    # a simulated finger of the generator has 0.3 to 0.8
    value, std = found["finger"]["cof_off"]
    assert 0.25 < value < 0.85
    assert 0.0 < std < 0.1


def test_settings_that_were_not_measured_lie_between_those_that_were(folder):
    seen, asked = (rows_of(folder / part / "001.csv") for part in ("sets", "unseen"))
    assert len(asked) == 24
    assert set(asked[0]) == set(seen[0]) - {"cof", "cof_std", "trial"}
    for column in asked[0]:
        driven = [float(row[column]) for row in seen if float(row["voltage_v"]) > 0.0]
        there = [float(row[column]) for row in asked]
        assert min(driven) <= 1.00001 * min(there)
        assert max(there) <= 1.00001 * max(driven)  # written with six digits


def test_a_method_that_is_not_there_is_refused(folder, tmp_path, refuses):
    words = ["--out", tmp_path / "a.json", "--method", "aic"]
    assert "'aicc'" in refuses("bad_method", "challenge", "answer", folder, *words)["hint"]
    assert not (tmp_path / "a.json").exists()


def test_written_answers_are_read_as_they_were(folder, tmp_path):
    columns = {name: rows_of(folder / "sets" / name)[0] for name in RIGHT}
    answers = read_answers(written(tmp_path / "a.json", RIGHT), columns)
    write_answers(tmp_path / "b.json", answers)
    assert read_answers(tmp_path / "b.json", columns) == answers
