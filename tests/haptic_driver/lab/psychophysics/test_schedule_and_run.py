"""Sessions: the order of trials, what is kept of them, and going on after a crash as if there had
been none.
"""

import csv
import json
import math
import sys
import types
from collections import Counter
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from haptic_driver.config import texture_dirs
from haptic_driver.errors import BadInputError, HapticError
from haptic_driver.lab.psychophysics.analysis import analyse
from haptic_driver.lab.psychophysics.apparatus import AssumedApparatus
from haptic_driver.lab.psychophysics.data import COLUMNS, SessionFiles, label_of
from haptic_driver.lab.psychophysics.delivery import NO_ONSET, Delivered
from haptic_driver.lab.psychophysics.description import Stimulus, load_experiment
from haptic_driver.lab.psychophysics.functions import Psychometric
from haptic_driver.lab.psychophysics.rehearsal import pretended, reached, try_design
from haptic_driver.lab.psychophysics.run import PretendedParticipant, run_session
from haptic_driver.lab.psychophysics.schedule import (
    Schedule,
    balanced,
    correct_answer,
    positive_answer,
)
from haptic_driver.textures.library import load
from tests.haptic_driver.commands import rows_of
from tests.haptic_driver.lab.psychophysics.files import (
    CONDITION,
    CONSTANT,
    QUEST_PLUS,
    STAIRCASE,
    made,
)
from tests.haptic_driver.lab.refusal import refused

TWO = '[[condition]]\nname = "a"\ncof = 0.5\n[[condition]]\nname = "b"\ncof = 0.6\n'


def all_trials(schedule, answer=lambda trial: True):
    found = []
    while (trial := schedule.next()) is not None:
        assert schedule.next() == trial
        found.append(trial)
        schedule.report(trial, answer(trial))
    return found


# --- the order
# ------------------------------------------------------------------------------------------------


def test_the_order_follows_from_seed_and_names_alone(tmp_path):
    experiment = made(tmp_path, "seed = 5", conditions=TWO)
    orders = [
        all_trials(Schedule(experiment, who, ses))
        for who, ses in (("P1", "01"), ("P1", "01"), ("P2", "01"), ("P1", "02"))
    ]
    assert orders[0] == orders[1]
    assert orders[0] != orders[2] != orders[3] != orders[0]
    for order in orders:
        assert Counter((t.condition, t.level) for t in order) == {
            (c, x): 2 for c in "ab" for x in (0.05, 0.1, 0.2)
        }
    assert {t.position for t in orders[0]} == {0, 1}


def test_practice_comes_first_and_breaks_where_they_are_due(tmp_path):
    experiment = made(
        tmp_path, "practice = 2\npractice_level = 0.9\nbreak_every = 4", conditions=TWO
    )
    trials = all_trials(Schedule(experiment, "P1", "01"))
    assert [t.level for t in trials[:2]] == [0.9, 0.9]
    assert [t.practice for t in trials] == [True, True] + 12 * [False]
    assert [t.number for t in trials if t.break_before] == [5, 9, 13]


def test_blocks_are_kept_apart_and_a_shuffle_is_the_participants_own(tmp_path):
    blocks = '[[block]]\nconditions = ["a"]\n[[block]]\nconditions = ["b"]\n'
    firsts = set()
    for who in ("P1", "P2", "P3", "P4"):
        experiment = made(tmp_path, 'block_order = "random"', conditions=TWO + blocks)
        trials = all_trials(Schedule(experiment, who, "01"))
        order = [t.condition for t in trials]
        assert order in (6 * ["a"] + 6 * ["b"], 6 * ["b"] + 6 * ["a"])
        assert [t.number for t in trials if t.break_before] == [7]
        firsts.add(order[0])
    assert firsts == {"a", "b"}


@pytest.mark.parametrize("count", [1, 2, 3, 4, 5, 6])
def test_a_balanced_order_has_every_block_as_often_in_every_place_and_after_every_other(count):
    orders = [balanced(count, number) for number in range(1, count * (1 + count % 2) + 1)]
    for place in zip(*orders, strict=True):
        assert set(Counter(place).values()) == {1 + count % 2}
    pairs = Counter(pair for order in orders for pair in pairwise(order))
    assert len(pairs) == count * (count - 1)
    assert len(set(pairs.values())) <= 1


def test_balanced_blocks_go_by_the_number_of_the_participant(tmp_path):
    blocks = '[[block]]\nconditions = ["a"]\n[[block]]\nconditions = ["b"]\n'
    experiment = made(tmp_path, 'block_order = "balanced"', conditions=TWO + blocks)
    firsts = [
        Schedule(experiment, f"P{number:02}", "01").next().condition for number in range(1, 5)
    ]
    assert firsts == ["a", "b", "a", "b"]
    with pytest.raises(BadInputError, match="number at the end"):
        Schedule(experiment, "Anna", "01")


def test_what_was_not_delivered_comes_again(tmp_path):
    schedule = Schedule(made(tmp_path), "P1", "01")
    trials = all_trials(schedule, lambda trial: None if trial.number in (2, 5) else True)
    assert len(trials) == 8
    assert Counter(t.level for t in trials if t.number not in (2, 5)) == {0.05: 2, 0.1: 2, 0.2: 2}


def test_the_comparison_is_where_the_trial_says(tmp_path):
    experiment = made(tmp_path, tables="[trial]\nintervals = 3\n" + CONSTANT)
    schedule = Schedule(experiment, "P1", "01")
    trial = schedule.next()
    shown = schedule.stimuli(trial)
    assert shown[trial.position].cof == pytest.approx(0.5 * (1.0 + trial.level))
    assert shown.count(Stimulus(0.5)) == 2
    for answer in range(3):
        right = answer == trial.position
        assert positive_answer(trial, answer, 3) == correct_answer(trial, answer, 3) == right
    less = trial._replace(level=-0.1)
    assert correct_answer(less, (less.position + 1) % 2, 2) is True
    assert correct_answer(trial._replace(level=0.0), 0, 2) is None
    assert (positive_answer(trial, 0, 1), positive_answer(trial, 1, 1)) == (True, False)
    assert correct_answer(trial, 0, 1) is None


# --- sessions
# ------------------------------------------------------------------------------------------------


class Leaves:
    """Somebody who answers like another, and presses Ctrl-C instead of the answer to a trial."""

    answered_s = None

    def __init__(self, other, at):
        self._other, self._at, self.waited = other, at, []

    def ask(self, question):
        if question.number == self._at:
            raise KeyboardInterrupt
        return self._other.ask(question)

    def wait(self, text):
        self.waited.append(text)

    def tell(self, text):
        pass


class NoFinger(AssumedApparatus):
    """A rig that nobody touches, from some trial on."""

    def __init__(self, since):
        self.since, self.presented = since, 0

    def present(self, stimuli, settings, settle_s):
        self.presented += 1
        there = super().present(stimuli, settings, settle_s)
        return there if self.presented < self.since else [Delivered()] * len(stimuli)


def session_of(experiment, folder, participant=None, apparatus=None, model="reference"):
    files = SessionFiles(folder, "P1", "01", "made")
    about = {
        "Experiment": experiment.file.model_dump(mode="json", exclude_none=True),
        "Rig": {"model": model},
    }
    return files, run_session(
        experiment,
        files,
        apparatus or AssumedApparatus(),
        participant or pretended(experiment, "P1", "01"),
        about,
    )


def stopped(experiment, folder, at):
    """A session that ends with Ctrl-C instead of the answer to that trial."""
    with pytest.raises(KeyboardInterrupt):
        session_of(experiment, folder, Leaves(pretended(experiment, "P1", "01"), at))


def kept(files):
    """Every row, but for what the clock says."""
    return [row._replace(response_time_s=0.0, time_s=0.0).cells() for row in files.rows()]


@pytest.mark.parametrize(
    "tables", [CONSTANT, QUEST_PLUS.replace("120", "9"), STAIRCASE.replace("240", "9")]
)
def test_a_session_that_was_stopped_goes_on_as_if_it_had_not_been(tmp_path, tables):
    experiment = made(tmp_path, "practice = 1\npractice_level = 0.4", tables)
    whole, progress = session_of(experiment, tmp_path / "whole")
    assert progress.done
    for at in (2, 5):
        stopped(experiment, tmp_path / "stopped", at)
    files = SessionFiles(tmp_path / "stopped", "P1", "01", "made")
    with files.table.open("a") as file:
        file.write("5\t1\ta\t0\t0.1")  # what a crash leaves of a line
    files, progress = session_of(experiment, tmp_path / "stopped")
    assert (progress.done, progress.presented_now) == (True, progress.trials - 4)
    assert kept(files) == kept(whole)


class Wanderer:
    """An optimiser of others that suggests something else every time it is made; `told` outlives
    it.
    """

    made = 0
    told = ()

    def __init__(self, experiment, condition):
        Wanderer.made += 1
        self._level = 0.1 * Wanderer.made
        Wanderer.told = []

    def suggest(self):
        return self._level

    def report(self, level, positive):
        Wanderer.told.append((pytest.approx(level), positive))


def test_an_optimiser_of_others_is_told_everything_again_after_a_crash(tmp_path, monkeypatch):
    module = types.ModuleType("wanderer")
    module.Wanderer = Wanderer
    monkeypatch.setitem(sys.modules, "wanderer", module)
    experiment = made(
        tmp_path, tables='[method]\nkind = "outside"\npython = "wanderer:Wanderer"\ntrials = 5\n'
    )
    stopped(experiment, tmp_path / "out", 4)
    files, progress = session_of(experiment, tmp_path / "out")
    assert progress.done
    rows = files.rows()
    assert [row.level for row in rows] == pytest.approx([0.1, 0.1, 0.1, 0.2, 0.2])
    assert Wanderer.told == [(row.level, row.positive) for row in rows]


@pytest.mark.parametrize("left", ["", "tri", None])
def test_a_crash_at_the_very_beginning_leaves_nothing_in_the_way(tmp_path, left):
    experiment = made(tmp_path)
    stopped(experiment, tmp_path / "out", 1)
    files = SessionFiles(tmp_path / "out", "P1", "01", "made")
    if left is not None:
        files.table.write_text(left)
    session_of(
        experiment, tmp_path / "out", model="another"
    )  # nothing was presented with the first
    assert len(files.rows()) == 6


def test_a_session_does_not_go_on_with_another_model(tmp_path):
    experiment = made(tmp_path)
    stopped(experiment, tmp_path / "out", 3)
    with refused("another_rig", "begun with model reference, now another"):
        session_of(experiment, tmp_path / "out", model="another")


def test_a_session_that_is_over_or_of_another_file_is_refused(tmp_path):
    experiment = made(tmp_path)
    session_of(experiment, tmp_path / "out")
    with refused("session_complete", "is complete"):
        session_of(experiment, tmp_path / "out")
    with refused("another_experiment", "is not one of"):
        session_of(made(tmp_path, "seed = 9"), tmp_path / "out")


def test_what_the_rig_did_not_do_is_marked_left_out_and_ends_it_when_it_goes_on(tmp_path):
    experiment = made(tmp_path, tables="[delivery]\nretries = 2\n" + CONSTANT)
    with refused("not_delivered", "slid for 0 s", hint="duration_s", kind=HapticError):
        session_of(experiment, tmp_path / "out", apparatus=NoFinger(since=4))
    files = SessionFiles(tmp_path / "out", "P1", "01", "made")
    assert [row.delivered for row in files.rows()] == 3 * [True] + 3 * [False]
    (result,) = analyse(tmp_path / "out")
    assert (result.trials, len(result.left_out)) == (3, 3)
    assert session_of(experiment, tmp_path / "out")[1].done


def test_the_files_are_those_of_bids_with_every_column_explained(tmp_path):
    experiment = made(tmp_path, 'instructions = "Slide."\nbreak_every = 3')
    somebody = Leaves(pretended(experiment, "P1", "01"), at=0)
    files, _ = session_of(experiment, tmp_path / "out", somebody)
    assert somebody.waited == ["Slide.", "A break."]
    place = files.table.relative_to(tmp_path / "out").as_posix()
    assert place == "sub-P1/ses-01/beh/sub-P1_ses-01_task-made_beh.tsv"
    with files.table.open(newline="") as file:
        rows = list(csv.DictReader(file, delimiter="\t"))
    sidecar = json.loads(files.sidecar.read_text())
    assert set(rows[0]) == set(COLUMNS) <= set(sidecar)
    assert sidecar["comparison_normal_force_n"]["Units"] == "N"
    assert (sidecar["TaskName"], sidecar["ExperimentHash"]) == ("made", experiment.content_hash)
    assert [int(row["trial"]) for row in rows] == list(range(1, 7))
    for row in rows:
        asked_cof = 0.5 * (1 + float(row["level"]))
        assert float(row["comparison_asked_cof"]) == pytest.approx(asked_cof)
        assert row["why_not_delivered"] == "n/a"
    assert (tmp_path / "out" / "participants.tsv").read_text() == "participant_id\nsub-P1\n"
    assert json.loads((tmp_path / "out" / "dataset_description.json").read_text())["BIDSVersion"]
    table = rows_of(tmp_path / "out" / "sub-P1.csv")
    assert [row["session"] for row in table] == 6 * ["01"]
    assert [row["response"] for row in table] == [row["response"] for row in rows]


def test_yes_and_no_leave_the_standard_out(tmp_path):
    experiment = made(tmp_path, tables="[trial]\nintervals = 1\n" + CONSTANT)
    files, _ = session_of(experiment, tmp_path / "out")
    first = files.rows()[0]
    assert first.response in ("yes", "no")
    assert first.positive == (first.response == "yes")
    assert first.correct is None
    assert math.isnan(first.standard.felt_cof)
    assert first.felt_level == pytest.approx(first.level)


def test_times_keep_their_microseconds_on_a_machine_that_has_been_up_for_days(tmp_path):
    files, _ = session_of(made(tmp_path), tmp_path / "out")
    late = files.rows()[0]._replace(time_s=864000.123456)
    files.append(late)
    assert files.rows()[-1].time_s == late.time_s


# --- thresholds that are known
# ---------------------------------------------------------------------------------------


def test_what_a_rig_reaches_of_a_design(tmp_path):
    """Levels 0.05 to 0.2 on frictions 0.5 and 0.6, by a rig whose 0.532 to 0.65 reach 0.505 to
    0.6825 within 5 %.
    """
    experiment = made(tmp_path, conditions=TWO)
    low, both = (
        reached(experiment, condition, (0.505 / 0.95, 0.65))
        for condition in experiment.file.condition
    )
    assert (low.asked_cof, low.standard_is_reached) == (pytest.approx((0.5, 0.6)), False)
    assert both.asked_cof == pytest.approx((0.6, 0.72))
    assert both.standard_is_reached
    assert both.reached_levels == pytest.approx((0.05, 0.1375))
    assert reached(experiment, experiment.condition("b"), (0.2, 0.5)).reached_levels is None
    alone = made(tmp_path, tables="[trial]\nintervals = 1\n" + CONSTANT)
    assert reached(alone, alone.condition("a"), (0.6, 0.8)).standard_is_reached


def test_what_a_rig_reaches_of_textures_is_what_the_textures_ask_for(tmp_path):
    """`grating` asks for 0.6 to 0.8, `uniform` for 0.6 everywhere."""
    conditions = """[[condition]]
name = "threads"
texture = "uniform"
comparisons = [{ level = 0.1, texture = "uniform" }, { level = 0.2, texture = "grating" }]
"""
    experiment = made(tmp_path, conditions=conditions)
    (condition,) = experiment.file.condition
    grating = load("grating", texture_dirs()).target.bounds()
    (uniform,) = set(load("uniform", texture_dirs()).target.bounds())
    within = reached(experiment, condition, grating)
    assert within.standard_is_reached
    assert within.asked_cof == pytest.approx((min(grating[0], uniform), max(grating[1], uniform)))
    assert within.reached_levels == (0.1, 0.2)
    assert [one.texture for one in within.textures] == ["uniform", "grating"]
    narrow = reached(experiment, condition, (uniform - 0.001, uniform + 0.001))
    assert (narrow.standard_is_reached, narrow.reached_levels) == (True, (0.1, 0.1))
    assert narrow.textures[1].share_above > 0.1
    assert "out of reach" in narrow.textures[1].said()
    none = reached(experiment, condition, (uniform + 0.2, uniform + 0.3))
    assert (none.standard_is_reached, none.reached_levels) == (False, None)


@pytest.mark.parametrize(
    ("name", "label"),
    [
        ("made", "made"),
        ("Reibung: Größe & Kraft", "ReibungGroeKraft"),
        ("é_1", "e1"),
        ("摩擦", "6377f852"),  # by sha256sum
    ],
)
def test_a_name_of_any_words_has_its_letters_and_digits_in_the_names_of_files(name, label):
    assert label_of(name) == label


def test_results_of_an_experiment_with_a_free_name_are_found_again(tmp_path):
    path, by_hand = tmp_path / "free.toml", CONDITION.replace('"a"', '"by hand"')
    path.write_text(f'name = "A look: linen & co"\n{CONSTANT}\n{by_hand}')
    experiment = load_experiment(str(path))
    files = SessionFiles(tmp_path / "out", "P1", "01", experiment.file.name)
    about = {"Experiment": experiment.file.model_dump(mode="json", exclude_none=True)}
    run_session(experiment, files, AssumedApparatus(), pretended(experiment, "P1", "01"), about)
    assert files.table.name == "sub-P1_ses-01_task-Alooklinenco_beh.tsv"
    (result,) = analyse(tmp_path / "out")
    assert (result.task, result.trials) == ("A look: linen & co", 6)
    assert result.axis == "friction above 0.5, as a share of it"


class Heard(AssumedApparatus):
    """Keeps what is marked; the last interval could be felt from 90 s on."""

    onset = NO_ONSET._replace(onset_s=90.0, onset_error_s=0.012)

    def __init__(self):
        self.marked = []

    def mark(self, label, data):
        self.marked.append((label, data))
        return 0.0


class AnsweredByMarker(PretendedParticipant):
    answered_s = 92.5


def test_response_time_counts_from_when_the_last_interval_could_be_felt(tmp_path):
    experiment, apparatus = made(tmp_path), Heard()
    somebody = AnsweredByMarker(Psychometric("weibull", 0.1, 3.0, 0.5))
    files, _ = session_of(experiment, tmp_path / "out", somebody, apparatus)
    assert {(row.response_time_s, row.onset_error_s) for row in files.rows()} == {(2.5, 0.012)}
    assert "answered" not in [label for label, _ in apparatus.marked]  # its marker is there


def test_a_table_of_an_earlier_version_goes_on_with_its_own_columns(tmp_path):
    experiment, apparatus = made(tmp_path), Heard()
    files, _ = session_of(experiment, tmp_path / "out", apparatus=apparatus)
    first, rows = (
        files.rows()[0],
        [line.split("\t") for line in files.table.read_text().split("\n")],
    )
    later = rows[0].index("onset_error_s")
    older = ["\t".join([*row[:later], *row[later + 1 :]]) for row in rows]
    files.table.write_text("\n".join(older))
    files.append(first)
    assert len({line.count("\t") for line in files.table.read_text().splitlines()}) == 1
    assert files.rows()[-1].cells() == first.cells() | {"onset_error_s": "n/a"}


def test_who_answers_without_a_marker_is_marked_with_the_answers_number(tmp_path):
    experiment, apparatus = made(tmp_path), Heard()
    files, _ = session_of(experiment, tmp_path / "out", apparatus=apparatus)
    numbers = [data["answer"] for label, data in apparatus.marked if label == "answered"]
    responses = [("first", "second")[number - 1] for number in numbers]
    assert responses == [row.response for row in files.rows()]


@pytest.mark.soak
def test_staircase_and_quest_plus_find_a_known_threshold_and_agree(tmp_path):
    """Twenty simulated participants of threshold 0.15, by both: medians within 10 % of it and of
    each other.
    """
    found = []
    for tables in (STAIRCASE, QUEST_PLUS):
        experiment = made(
            tmp_path, tables=tables + "[simulated]\nthreshold = 0.15\nslope = 3.0\nlapse = 0.02\n"
        )
        (one,) = try_design(experiment, 20)
        assert one.fitted == 1.0
        assert one.held_by_interval >= 0.75
        assert one.relative_std < 0.25
        found.append(one.median)
    np.testing.assert_allclose(found, 0.15, rtol=0.10)
    assert found[0] == pytest.approx(found[1], rel=0.10)


def test_of_the_real_texture_among_two_the_share_of_right_answers_is_told(haptic):
    """72 % of 10 times 40 answers, give or take 0.022; nothing is said of a threshold."""
    done = haptic("experiment", "simulate", "which_is_real", "--participants", 10, "--json").said
    shares = [one["positive"] for one in done["conditions"]]
    assert shares == pytest.approx([0.72, 0.72], abs=0.06)
    for condition in load_experiment("which_is_real").file.condition:
        found = reached(load_experiment("which_is_real"), condition, (0.5, 0.9))
        assert found.standard_is_reached
        assert found.reached_levels == (1.0, 1.0)


class RightInThree(PretendedParticipant):
    """Right in the first three of four trials."""

    def ask(self, question):
        position = question.trial.position
        return position if question.number <= 3 else 1 - position


def test_the_share_at_one_level_has_wilsons_interval(tmp_path):
    one = '[method]\nkind = "constant"\nlevels = [0.1]\nrepeats = 4\n'
    session_of(
        made(tmp_path, tables=one),
        tmp_path / "out",
        RightInThree(Psychometric("weibull", 0.1, 3.0, 0.5)),
    )
    (result,) = analyse(tmp_path / "out")
    # 3 of 4 by Wilson 1927: (p + z^2/2n -+ z sqrt(p q/n + z^2/4n^2)) / (1 + z^2/n), z = 1.96
    assert result.positive == pytest.approx((0.75, 0.3006, 0.9544), abs=1e-4)
    assert result.numbers()["positive_high"] == result.positive[2]


def test_a_rehearsal_leaves_what_people_leave_and_the_mean_is_by_students_t(haptic, tmp_path):
    """Student's t of two values is 12.706; the interval of a mean, that over the root of two."""
    experiment = made(tmp_path, tables=CONSTANT.replace("repeats = 2", "repeats = 40"))
    out = tmp_path / "out"
    done = haptic(
        "experiment", "simulate", experiment.path, "--participants", "2", "--out", out, "--json"
    )
    assert all(Path(path).exists() for path in done.said["written"])
    session = out / "sub-S0001" / "ses-01" / "beh" / "sub-S0001_ses-01_task-made_beh.tsv"
    assert len(rows_of(session)) == 120
    again = haptic("experiment", "simulate", experiment.path, "--out", out)
    assert (again.status, "exists" in again.err) == (2, True)
    said = haptic("experiment", "analyse", out, "--json").said
    first, second = (float(result["threshold"]) for result in said["results"])
    (group,) = said["groups"]
    half = 12.706 * abs(first - second) / 2.0
    assert group["mean"] == pytest.approx((first + second) / 2.0)
    assert group["mean_95"] == pytest.approx([group["mean"] - half, group["mean"] + half], rel=1e-4)
    assert "mean of 2, a:" in haptic("experiment", "analyse", out).out


@pytest.mark.parametrize(
    ("threshold", "why", "empty", "given"),
    [
        (1e-6, "below 0.05, the lowest", "low", "high"),
        (1e6, "above 0.2, the highest", "high", "low"),
    ],
    ids=["everything is felt", "nothing is felt"],
)
def test_answers_that_hold_no_threshold_leave_its_cells_empty(
    haptic, tmp_path, threshold, why, empty, given
):
    experiment = made(tmp_path, tables=CONSTANT.replace("repeats = 2", "repeats = 20"))
    somebody = PretendedParticipant(Psychometric("weibull", threshold, 3.0, 0.5))
    session_of(experiment, tmp_path / "out", somebody)
    done = haptic("experiment", "analyse", tmp_path / "out", "--json")
    (result,) = done.said["results"]
    (row,) = rows_of(Path(done.said["table"]))
    for numbers in (result, row):
        assert why in numbers["why_none"]
        assert [numbers[name] for name in ("threshold", "slope", "guess", "lapse")] == 4 * [""]
        assert numbers[f"threshold_{empty}"] == ""
        assert math.isfinite(float(numbers[f"threshold_{given}"]))
    table = haptic("experiment", "analyse", tmp_path / "out").out
    assert why[:10] in table
    assert ("up to" if given == "high" else "from") in table
