"""Scores of answers written by hand, against numbers computed by hand."""

import math
from dataclasses import replace

import numpy as np
import pytest

from haptic_driver.lab.challenge.answers import Answer
from haptic_driver.lab.challenge.scores import Truth, rows_in, scores

VOLTAGE_V = np.array([0.0, 50.0, 100.0, 100.0])
COLUMNS = {"voltage_v": VOLTAGE_V, "frequency_hz": np.array([250.0, 250.0, 10.0, 1e4])}
NOISE = np.full(4, 0.02)


def truth(*names, visibility=100.0, in_catalogue=True, change=(0.0, 0.01, -0.03, 0.05)):
    finger = {"cof_off": 0.5, "skin_thickness_m": 2e-4}
    of_rows = COLUMNS, np.array(change), NOISE
    return Truth(frozenset(names), in_catalogue, visibility, *of_rows, finger)


NOTHING = truth(visibility=0.0, change=(0.0, 0.0, 0.0, 0.0))
GAIN, GAP = "drive_gain_error", "speed_dependent_gap"


def count(found, key):
    return found["names"][key]["count"], found["names"][key]["of"]


@pytest.mark.parametrize(
    ("said", "named", "found", "wrong"),
    [
        ({"verdict": "named", "effects": [GAIN]}, 1, 1, 0),
        ({"verdict": "named", "effects": [GAP]}, 0, 0, 1),
        ({"verdict": "named", "effects": [GAIN, GAP]}, 0, 1, 1),
        ({"verdict": "listed", "effects": [GAP, GAIN]}, 0, 1, 0),
        ({"verdict": "listed", "effects": [GAP]}, 0, 0, 0),
        ({"verdict": "unknown"}, 0, 0, 0),
        ({"verdict": "nothing"}, 0, 0, 0),
    ],
)
def test_a_visible_single_effect(said, named, found, wrong):
    got = scores({"1": Answer(**said)}, {"1": truth(GAIN)})
    assert count(got, "single_named") == (named, 1)
    assert count(got, "single_found") == (found, 1)
    assert count(got, "wrong_name") == (wrong, 1)


def test_what_is_hardly_visible_is_asked_of_wrong_names_alone():
    got = scores({"1": Answer(verdict="nothing")}, {"1": truth(GAIN, visibility=74.9)})
    assert {key: n["of"] for key, n in got["names"].items() if n["of"]} == {"wrong_name": 1}


def test_pairs():
    truths = {name: truth(GAIN, GAP, visibility=1.0) for name in "123"}
    answers = {
        "1": Answer(verdict="named", effects=[GAP, GAIN]),
        "2": Answer(verdict="named", effects=[GAIN]),
        "3": Answer(verdict="listed", effects=[GAIN, "sweat_film", GAP]),
    }
    got = scores(answers, truths)
    assert count(got, "pair_named") == (1, 3)
    assert count(got, "pair_found") == (2, 3)
    assert count(got, "wrong_name") == (0, 3)


def test_abstention():
    outside = truth("stick_slip", in_catalogue=False)
    truths = {"1": NOTHING, "2": NOTHING, "3": NOTHING, "4": outside, "5": outside}
    answers = {
        "1": Answer(verdict="listed", effects=[GAIN]),
        "2": Answer(verdict="nothing"),
        "4": Answer(verdict="unknown"),
        "5": Answer(verdict="named", effects=[GAP]),
    }
    got = scores(answers, truths)
    assert count(got, "nothing_named") == (1, 2)
    assert count(got, "outside_unknown") == (1, 2)
    assert count(got, "outside_named") == (1, 2)
    assert count(got, "wrong_name") == (1, 4)
    assert got["answered"] == {
        "verdict": 4,
        "probability": 0,
        "where": 0,
        "strength": 0,
        "finger": 0,
        "predicted": 0,
    }
    assert got["sets"] == 5


@pytest.mark.parametrize(
    ("regions", "f1"),
    [
        # changed by more than 0.02 are the last two rows
        ([{"voltage_v": [100, 100]}], 1.0),
        ([{"voltage_v": [50, 100]}], 2 * 2 / (3 + 2)),
        ([{"frequency_hz": [1e3, 1e5]}, {"frequency_hz": [1, 20]}], 1.0),
        ([{"frequency_hz": [1e3, 1e5], "voltage_v": [0, 60]}], 0.0),
        ([], 0.0),
    ],
)
def test_place(regions, f1):
    got = scores({"1": Answer(where=regions)}, {"1": truth(GAIN)})["place"]
    assert got == {"f1": pytest.approx(f1), "sets": 1, "invented": {"count": 0, "of": 0}}


def test_a_region_of_frequencies_has_rows_with_voltage_alone():
    assert rows_in([{"frequency_hz": [200, 300]}], COLUMNS).tolist() == [False, True, False, False]


def test_a_place_where_nothing_is_changed_is_invented():
    answers = {"1": Answer(where=[{"voltage_v": [0, 60]}]), "2": Answer(where=[])}
    got = scores(answers, {"1": NOTHING, "2": NOTHING})["place"]
    assert got == {"f1": None, "sets": 0, "invented": {"count": 1, "of": 2}}


def test_strength_is_the_median_factor_off():
    # root mean square of 0, 0.01, -0.03, 0.05
    true = math.sqrt((0.01**2 + 0.03**2 + 0.05**2) / 4)
    said = {"1": true / 3, "2": true * 2, "3": true}
    truths = {name: truth(GAIN) for name in said} | {"4": NOTHING}
    answers = {name: Answer(strength=value) for name, value in said.items()}
    got = scores(answers | {"4": Answer(strength=0.1)}, truths)["strength"]
    assert got == {"factor_off": pytest.approx(2.0), "sets": 3}


def test_no_strength_where_there_is_some_is_off_without_bound():
    got = scores({"1": Answer(strength=0.0)}, {"1": truth(GAIN)})["strength"]
    assert got["factor_off"] == math.inf


def test_a_finger_is_off_by_so_many_of_its_own_deviations():
    said = {
        # one, three and two and a half deviations off
        "1": {"cof_off": [0.51, 0.01], "skin_thickness_m": [1.4e-4, 2e-5]},
        "2": {"cof_off": [0.45, 0.02]},
        # nothing is hidden: not asked
        "3": {"cof_off": [0.9, 0.01]},
    }
    answers = {name: Answer(finger=finger) for name, finger in said.items()}
    got = scores(answers, {"1": truth(GAIN), "2": truth(GAP), "3": NOTHING})["finger"]
    assert got["off_std"] == pytest.approx(2.5)
    assert got["beyond_two"] == {"count": 2, "of": 3}
    assert got["each"] == pytest.approx({"cof_off": 1.75, "skin_thickness_m": 3.0})


def test_calibration_is_by_the_truth_of_each_verdict():
    outside = truth("stick_slip", in_catalogue=False)
    truths = {"1": truth(GAIN, GAP), "2": truth(GAIN), "3": outside, "4": truth(visibility=1.0)}
    answers = {
        # true: a name of two is no wrong name
        "1": Answer(verdict="named", effects=[GAIN], probability=0.9),
        # false
        "2": Answer(verdict="listed", effects=[GAP, "sweat_film"], probability=0.95),
        "3": Answer(verdict="unknown", probability=0.6),
        # true: what is there leaves no trace
        "4": Answer(verdict="nothing", probability=1.0),
    }
    got = scores(answers, truths)["calibration"]
    # above 0.9: 2.85 stated, 2 true of 3; at 0.6: 0.6 stated, 1 true
    assert got["error"] == pytest.approx((0.85 + 0.4) / 4)
    assert got["sets"] == 4


def test_by_chance_calibrated_answers_are_off_too():
    """One answer at one half is off by one half, whatever happens."""
    got = scores({"1": Answer(verdict="nothing", probability=0.5)}, {"1": NOTHING})["calibration"]
    assert got["by_chance"] == pytest.approx(0.5)


UNSEEN = np.geomspace(0.4, 0.9, 24)
TURNS = np.tile([1.0, -1.0], 12)


def seen_elsewhere(visibility):
    """A finger in which the hidden changes friction by 10 % up or down in turns."""
    of_rows = COLUMNS, np.full(4, 0.05), NOISE, {}
    return Truth(frozenset({GAIN}), True, visibility, *of_rows, UNSEEN, np.expm1(0.1 * TURNS))


@pytest.mark.parametrize(
    ("off", "error", "share"),
    [
        (np.zeros(24), 0.0, 1.0),
        (np.full(24, 0.3), 0.0, 1.0),  # a common factor is free
        (-0.1 * TURNS, 0.1, 0.0),  # what is hidden is not predicted
        (-0.02 * TURNS, 0.02, 0.8),
    ],
)
def test_predictions_of_settings_that_were_not_measured(off, error, share):
    answer = Answer(predicted=list(UNSEEN * np.exp(off)))
    got = scores({"1": answer, "2": answer}, {"1": seen_elsewhere(100.0), "2": seen_elsewhere(9.0)})
    assert got["proof"] == {
        "error": pytest.approx(error, abs=1e-12),
        "sets": 2,
        "share": pytest.approx(share),
        "visible": 1,
    }


def test_what_shows_in_the_current_alone_has_no_change_of_friction_to_predict():
    unfelt = replace(seen_elsewhere(100.0), change=np.zeros(4), unseen_change=np.zeros(24))
    got = scores({"1": Answer(predicted=list(UNSEEN))}, {"1": unfelt})
    assert got["proof"] == {"error": 0.0, "sets": 1, "share": None, "visible": 0}
