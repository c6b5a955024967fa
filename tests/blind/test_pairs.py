"""Twins of measured and commanded loads: what they share, how they are counted and kept."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest

from tests.blind.evaluate import run
from tests.blind.generator.__main__ import generate, write
from tests.blind.generator.build import Spec
from tests.blind.generator.families import as_measured
from tests.blind.pairs import pairs_of, pairs_table, so_far
from tests.blind.scores import Answer

GAIN, LOAD = "drive_gain_error", "load_dependent_friction"
SPECS = [
    as_measured(Spec("F0", 0, design="paper")),
    as_measured(Spec("F1", 1, ((GAIN, 100.0),), design="paper")),
]


@pytest.fixture(scope="module")
def sets():
    return generate(SPECS, seed=3)


def test_twins_share_finger_plan_effect_and_lambda(sets):
    assert len(sets) == 4
    for made, twin in ((sets[0], sets[1]), (sets[2], sets[3])):
        assert ("trials" in made.label, "trials" in twin.label) == (True, False)
        assert made.label["pair"] == twin.label["pair"]
        assert made.label["finger"] == twin.label["finger"]
        assert made.label["design"] == twin.label["design"]
        assert made.label["rows"] == 2 * twin.label["rows"]
        loads = twin.columns["normal_force_n"]
        assert np.unique(loads).size <= 3
        assert made.label["effects"] == twin.label["effects"]


def test_rows_of_a_twin_scatter_as_means_of_trials_do():
    spec = as_measured(Spec("F0", 0, design="voltage_frequency"))
    made, twin = generate([spec], seed=3)
    gain, sigma = made.label["trials"]["gain"], made.label["relative_sigma"]
    assert twin.label["relative_sigma"] == pytest.approx(np.hypot(gain, sigma / 2**0.5), rel=0.05)
    stated = twin.columns["cof_std"] / twin.columns["cof"]
    assert np.median(stated) == pytest.approx(twin.label["relative_sigma"], rel=0.2)


def test_twins_follow_one_another_and_files_of_another_run_go(sets, tmp_path):
    (tmp_path / "sets").mkdir()
    (tmp_path / "sets" / "9.csv").write_text("left over")
    write(sets, tmp_path, 3)
    labels = json.loads((tmp_path / "labels.json").read_text())
    assert sorted(file.name for file in (tmp_path / "sets").iterdir()) == sorted(labels)
    pairs = [labels[name]["pair"] for name in sorted(labels)]
    assert pairs[::2] == pairs[1::2]
    assert len(set(pairs)) == 2


def said(verdict: str, *names: str, top: str = "none") -> Answer:
    return Answer(verdict, names, (), top, 0.9, "none", "none")


def label(pair: str, measured: bool, *effects: tuple[str, float], stranger: bool = False) -> Any:
    told = [{"name": n, "lambda": seen, "stranger": stranger} for n, seen in effects]
    return {"pair": pair, "effects": told} | ({"trials": {}} if measured else {})


LABELS = {
    "1": label("a", True, (GAIN, 90.0)),
    "2": label("a", False, (GAIN, 110.0)),
    "3": label("b", False, (LOAD, 50.0)),
    "4": label("b", True, (LOAD, 50.0)),
    "5": label("c", True),
    "6": label("c", False),
    "7": label("d", True, ("mains_interference", 300.0), stranger=True),
    "8": label("d", False, ("mains_interference", 300.0), stranger=True),
    "9": label("e", True, (GAIN, 70.0)),
}
ANSWERS = {
    "1": said("effect_found", GAIN, top=GAIN),
    "2": said("ambiguous", top=GAIN),
    "3": said("effect_found", LOAD, top=LOAD),
    "4": said("effect_found", GAIN, LOAD, top=GAIN),
    "5": said("no_discrepancy"),
    "6": said("no_discrepancy"),
    "7": said("effect_found", GAIN, top=GAIN),
    "8": said("unexplained", top="unknown"),
    "9": said("no_discrepancy"),
}


def test_what_is_counted_is_of_both_twins():
    """Names of two pairs with effects of the catalogue, wrong names of all four; one has no twin
    yet.
    """
    pairs = pairs_of(ANSWERS, LABELS)
    assert [pair.measured for pair in pairs] == ["1", "4", "5", "7"]
    line = so_far(pairs, 5)
    assert line.startswith("4 of 5 pairs, measured : commanded; ")
    # Wilson's interval by hand: 1.96^2 is 3.84.
    # Wilson's intervals by hand: 1.96^2 is 3.84.
    assert "effects are named 50 (9..91), 1/2 : 50 (9..91), 1/2; " in line
    assert "a wrong name is given 50 (15..85), 2/4 : 0 (0..49), 0/4; " in line
    assert "a hidden effect leads 50 (9..91), 1/2 : 100 (34..100), 2/2" in line
    table = pairs_table(pairs)
    assert "median lambda of what is hidden 90 as measured, 110 as commanded" in table
    (wrong,) = [row for row in table.splitlines() if row.startswith("| a wrong name")]
    assert wrong.split("|")[2].strip() == "50 (15..85), 2/4"
    assert wrong.split("|")[4].strip() == "100 (34..100), 2/2"


@pytest.mark.process
def test_answers_are_kept_by_content_and_told_one_by_one(tmp_path):
    """A greater scale renumbers the files, and asks only about what is new."""
    folder = tmp_path / "sets"
    folder.mkdir()
    head = "frequency_hz,voltage_v,normal_force_n,cof\n"
    for name, cof in (("1.csv", 0.5), ("2.csv", 0.6)):
        (folder / name).write_text(f"{head}100,50,0.5,{cof}\n")
    heard: list[int] = []
    first = run(tmp_path, 1, lambda answers: heard.append(len(answers)))
    assert heard == [1, 2]
    assert {got.verdict for got in first.values()} == {"not_testable"}
    (folder / "2.csv").rename(folder / "4.csv")
    (folder / "2.csv").write_text(f"{head}100,50,0.5,0.7\n")
    heard.clear()
    again = run(tmp_path, 1, lambda answers: heard.append(len(answers)))
    assert heard == [3]
    assert list(again) == ["1.csv", "2.csv", "4.csv"]
    assert again["4.csv"] == first["2.csv"]
