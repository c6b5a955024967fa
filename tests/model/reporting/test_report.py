"""Every verdict's report keeps the public contract, and its page stands alone."""

from __future__ import annotations

import csv
import json
import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest

from model.conditions import Conditions
from model.description import ModelDescription, read_model
from model.diagnosis.data import Array, read_measurements
from model.diagnosis.proof import Proof
from model.diagnosis.workflow import Diagnosis, diagnose
from model.effects import BY_NAME
from model.parameters import Parameter
from model.reporting.page import gap_said, question, sentence
from model.reporting.pictures import _apart, fingerprint, held_out
from model.reporting.report import write_report
from model.touch_model import TouchModel
from tests.fingers import FINGER, hiding
from tests.reports import without_pictures

FREQUENCIES, VOLTAGES, LOADS = (1.0, 10.0, 100.0, 1e3, 1e4, 1e6), (50.0, 100.0), (0.2, 0.5, 1.5)
SESSIONS, NOISE, GAIN = ("Mon", "<b>Tue & $Wed", "Thu"), 0.02, 0.03
Distortion = Callable[[Array, Array, Array], Array]
Effects = dict[str, dict[str, float]]


@dataclass(frozen=True)
class Case:
    """A made-up data set: effects that are on, what else distorts friction, and the verdict it
    earns.
    """

    verdict: str
    effects: Effects
    distortion: Distortion | None = None
    stated_noise: bool = True
    time_step_s: float = 0.0


def _stranger(f: Array, v: Array, n: Array) -> Array:
    return np.where(
        v > 0.0, 0.2 * np.sin(2.2 * np.log(np.maximum(f, 1.0))) + 0.1 * np.sin(6.0 * n), 0.0
    )


CASES = (
    Case("no_discrepancy", {}, time_step_s=5.0),
    Case("effect_found", {"load_dependent_friction": {"exponent": 0.7}}),
    Case("ambiguous", {"series_resistance": {"resistance_ohm": 2e4}}),
    Case("unexplained", {}, _stranger),
    Case("not_testable", {}, stated_noise=False),
)


def write_data(path: Path, case: Case) -> None:
    """Three sessions of every setting, with 2 % noise; without a stated noise, one session without
    repeats.
    """
    sessions, quiet = (SESSIONS, 2) if case.stated_noise else (SESSIONS[:1], 1)
    one = [(f, v, n) for f in FREQUENCIES for v in VOLTAGES for n in LOADS] + [
        (0.0, 0.0, n) for n in LOADS
    ] * quiet
    f, v, n = np.tile(np.array(one), (len(sessions), 1)).T
    session = np.repeat(np.arange(len(sessions)), len(one))
    rng = np.random.default_rng(0)
    touch = TouchModel(hiding(FINGER, **case.effects))
    log_cof = np.log(touch.predict(Conditions(f, v, n)).cof)
    log_cof += 0.0 if case.distortion is None else case.distortion(f, v, n)
    log_cof += NOISE * rng.normal(size=f.size) + GAIN * rng.normal(size=len(sessions))[session]
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        stated = ["cof_std"] if case.stated_noise else []
        writer.writerow(
            ["frequency_hz", "voltage_v", "normal_force_n", "time_s", "session", "cof", *stated]
        )
        for i, cof in enumerate(np.exp(log_cof)):
            row = [f[i], v[i], n[i], case.time_step_s * i, sessions[session[i]], cof, NOISE * cof]
            writer.writerow(row[: 6 + len(stated)])


@dataclass(frozen=True)
class Run:
    """One case, diagnosed and reported."""

    case: Case
    diagnosis: Diagnosis
    content: dict[str, Any]
    folder: Path

    @property
    def page(self) -> str:
        return (self.folder / "report.html").read_text(encoding="utf-8")


@pytest.fixture(scope="module", params=CASES, ids=lambda case: case.verdict)
def run(request, tmp_path_factory):
    folder: Path = tmp_path_factory.mktemp("report")
    source = folder / "slides <i>& more.csv"
    write_data(source, request.param)
    found = diagnose(FINGER, read_measurements(source), seed=3)
    return Run(
        request.param,
        found,
        write_report(found, FINGER, folder / "out", str(source)),
        folder / "out",
    )


def test_the_contract_is_kept_in_strict_json(run):
    text = (run.folder / "report.json").read_text(encoding="utf-8")
    content = json.loads(text, parse_constant=pytest.fail)
    assert content == run.content
    assert content["verdict"] == run.case.verdict
    assert isinstance(content["adequate"], bool)
    assert content["model"] == str(run.folder / "model.toml")
    assert content["seed"] == 3
    assert set(content["fit"]) == {
        "chi2_per_point",
        "held_out_chi2_per_point",
        "gap_closed",
        "gap_closed_interval",
    }
    for part in ("chi2_per_point", "held_out_chi2_per_point"):
        assert set(content["fit"][part]) == {"before", "after"}
    assert len(content["fit"]["gap_closed_interval"]) == 2


def test_alternatives_are_everything_and_sum_to_one(run):
    names = [a["name"] for a in run.content["alternatives"]]
    values = [a["probability"] for a in run.content["alternatives"]]
    assert sorted(names) == sorted(["none", "unknown", *BY_NAME])
    assert sum(values) == pytest.approx(1.0, abs=1e-12)
    assert values == sorted(values, reverse=True)


def test_effects_are_named_only_where_the_verdict_names(run):
    named = run.case.verdict in ("effect_found", "ambiguous")
    learned = (
        ["learned"] if run.content["learned"] and run.content["learned"]["in_model"] else []
    )  # no name
    assert run.case.verdict == "unexplained" or not learned
    assert [e["name"] for e in run.content["effects"]] == (
        list(run.case.effects) if named else learned
    )
    for effect in run.content["effects"]:
        assert set(effect) == {"name", "probability", "parameters", "indistinguishable_from"}
        for p in effect["parameters"].values():
            assert set(p) == {"value", "std", "unit"}
        assert bool(effect["indistinguishable_from"]) == (run.case.verdict == "ambiguous")


def test_fitted_strength_is_the_true_one_within_its_error(run):
    for effect in run.content["effects"]:
        for name, p in effect["parameters"].items() if effect["name"] != "learned" else ():
            assert abs(p["value"] - run.case.effects[effect["name"]][name]) < 4.0 * p["std"]


def test_regions_are_given_strongest_first(run):
    found = run.content["where"]
    for region in found:
        assert {"axis", "low", "high", "p_value", "sign"} <= set(region)
        assert region["sign"] in (-1, 1)
        lists = [isinstance(region[key], list) for key in ("axis", "low", "high")]
        assert lists in ([True] * 3, [False] * 3)
    assert [r["p_value"] for r in found] == sorted(r["p_value"] for r in found)
    expected = run.case.verdict in ("effect_found", "ambiguous", "unexplained")
    assert bool(found and found[0]["p_value"] < 0.01) == expected


def test_the_rows_that_are_changed_are_said(run):
    """Those that what is hidden changes by more than the noise; at that edge some are missed."""
    data, said = run.diagnosis.data.columns, run.content["changed"]
    f, v, n = (data[name] for name in ("frequency_hz", "voltage_v", "normal_force_n"))
    change = np.zeros(f.size) if run.case.distortion is None else run.case.distortion(f, v, n)
    for name, values in run.case.effects.items():
        both = (FINGER, hiding(FINGER, **{name: values}))
        without, with_it = (TouchModel(m).predict(Conditions(f, v, n)).cof for m in both)
        change += np.log(with_it / without)
    true = np.abs(change) > NOISE
    told = np.zeros(f.size, bool)
    for box in said["where"]:
        inside = [(data[name] >= low) & (data[name] <= high) for name, (low, high) in box.items()]
        told |= np.all(inside, axis=0) & ((v > 0.0) | ("frequency_hz" not in box))
    assert said["rows"] == told.sum()
    assert said["of"] == (f.size if run.diagnosis.findings else 0)
    if run.diagnosis.findings and true.any():
        assert 2.0 * np.sum(true & told) > 0.8 * (true.sum() + told.sum())
    else:
        assert not told.any()


def test_a_found_effect_shrinks_the_discrepancy_on_unseen_data_more_than_its_rival(run):
    if run.case.verdict not in ("effect_found", "ambiguous"):
        pytest.skip("nothing was named")
    fit, rival = run.content["fit"], run.content["held_out"]["best_rival"]
    assert fit["held_out_chi2_per_point"]["after"] < fit["held_out_chi2_per_point"]["before"]
    # What is least probable of those that look alike is not listed, and closes as much.
    alike = run.case.verdict == "ambiguous"
    assert fit["gap_closed"] > (0.8 if alike else max(0.8, rival["gap_closed"]))


def test_what_to_measure_next_answers_the_verdict(run):
    """What has no name is measured again where it is strongest, and what no setting tells apart
    gets a physical check.
    """
    proposed = run.content["next_experiments"]
    if run.case.verdict == "unexplained":
        region = run.diagnosis.findings.before.regions[0]
        for axis, low, high in zip(region.axes, region.low, region.high, strict=True):
            assert low <= proposed[0][axis] <= high
    elif run.case.verdict == "ambiguous":
        assert [p["kind"] for p in proposed] == ["check", "check"]
        for check in proposed:
            assert check["check"] == BY_NAME[check["effect"]].check
            assert check["lambda_after"] < 9.0
    elif run.case.verdict == "not_testable":
        assert proposed == []


def test_untestable_data_leave_the_priors(run):
    if run.case.verdict != "not_testable":
        pytest.skip("tested")
    known = {a["name"]: a["probability"] for a in run.content["alternatives"]}
    assert known["none"] == pytest.approx(0.3)
    assert known["unknown"] == pytest.approx(0.14)
    assert known["floating_body"] == pytest.approx(0.56 / len(BY_NAME))
    assert run.content["fit"]["gap_closed"] is None
    assert run.content["reasons"]


def test_the_model_beside_it_holds_what_the_report_says(run):
    read = read_model(run.folder / "model.toml")
    assert list(read.effect_parameters) == [e["name"] for e in run.content["effects"]]
    for effect in run.content["effects"]:
        for name, p in effect["parameters"].items():
            assert read.effect_parameters[effect["name"]][name].value == p["value"]


def test_the_page_stands_alone(run):
    page = run.page
    for outside in ("http://", "https://", "<script", "<link", "@import", "url(", "javascript:"):
        assert outside not in page.lower()
    assert all(
        source.startswith("data:image/svg+xml;base64,")
        for source in re.findall(r'src="([^"]*)', page)
    )
    assert page.count("<img") == len(list((run.folder / "pictures").glob("*.svg")))


def test_the_page_escapes_what_files_say(run):
    assert "slides &lt;i&gt;&amp; more.csv" in run.page
    assert "<i>" not in run.page
    assert "<b>" not in run.page


def test_the_page_opens_with_the_verdict_in_words(run):
    heading = re.search(r"<h1>(.*?)</h1>", run.page, re.DOTALL)
    assert heading is not None
    words = {
        "no_discrepancy": "nothing missing",
        "effect_found": "Load dependent friction is missing from the model",
        "ambiguous": "cannot tell which: series resistance or amplifier bandwidth",
        "unexplained": "no effect that this program knows",
        "not_testable": "cannot test the model",
    }
    assert words[run.case.verdict] in heading[1]


def test_pictures_are_vectors(run):
    drawn = sorted((run.folder / "pictures").glob("*.svg"))
    expected = (
        ["fingerprint", "held_out", "probabilities", "residual_map"]
        if run.case.stated_noise
        else []
    )
    over_time = ["residual_over_time"] if run.case.time_step_s else []  # where there is one
    assert [p.stem for p in drawn] == expected + over_time
    for path in drawn:
        assert ElementTree.parse(path).getroot().tag.endswith("}svg")
    assert sorted(run.content["pictures"]) == list(map(str, drawn))


def test_the_named_effects_line_goes_through_what_the_data_show(run):
    """Points were without the sessions' gains and lines with them: they lay far apart."""
    if run.case.verdict != "effect_found":
        return
    drawn = fingerprint(run.diagnosis.data, run.diagnosis.findings)
    for ax in (ax for ax in drawn.axes if ax.get_visible()):
        points = np.concatenate(ax.containers[0].lines[0].get_xydata()[:, 1:])
        named = next(line for line in ax.lines if line.get_label() == "load dependent friction")
        off = np.abs(named.get_ydata() - points)
        assert off.max() < 3.0 * 100.0 * NOISE / 18**0.5, (
            ax.get_xlabel()
        )  # 18 rows a point, or more


def test_two_effects_read_as_a_sentence():
    content: dict[str, Any] = {
        "verdict": "effect_found",
        "effects": [{"name": "floating_body"}, {"name": "drive_gain_error"}],
        "probability": 0.98,
        "adequate": True,
        "fit": {"gap_closed": 0.913, "gap_closed_interval": [0.8, 0.97]},
        "left": [],
        "looks_like": [],
    }
    said = sentence(content)
    assert said.startswith("Floating body and drive gain error are missing from the model")
    assert "closes 91 % of the gap" in said
    assert said.endswith("nothing is left beyond chance.")
    place = {"axis": "frequency_hz", "low": 100.0, "high": 250.0}
    beside = sentence(content | {"adequate": False, "left": [place]})
    assert beside.endswith("what is left is most at frequency 100 to 250 Hz.")


def test_what_is_not_of_the_touch_comes_before_all_else():
    content = {"effects": [], "probability": 0.99, "verdict": "unexplained"}
    said = sentence(content | {"looks_like": ["a table with currents in mA looks like this: look"]})
    assert said.endswith("A table with currents in mA looks like this: look.")


@pytest.mark.parametrize(
    ("gain", "asked"),
    [(0.464, "peak to peak?"), (1.43, "rms?"), (2.05, "50 ohm"), (1.15, ""), (0.6, "")],
)
def test_a_gain_like_that_of_another_unit_is_asked_about(gain, asked):
    effect = {"name": "drive_gain_error", "parameters": {"gain": {"value": gain}}}
    said = question({"effects": [effect]})
    assert asked in said
    assert bool(said) == bool(asked)


def test_whole_hypotheses_sum_to_one_and_agree_with_the_names(run):
    listed = run.content["hypotheses"]
    assert bool(listed) == (run.case.verdict != "not_testable")
    total = sum(row["probability"] for row in listed)
    assert not listed or total == pytest.approx(1.0)
    for effect in run.content["effects"] if run.case.verdict == "effect_found" else ():
        held = sum(row["probability"] for row in listed if effect["name"] in row["names"])
        assert held == pytest.approx(effect["probability"], rel=1e-9)


@pytest.mark.parametrize("name", ["caf\udce9 $x_1$.csv", "a<b>&\x1b[2J.csv"])
def test_a_file_of_any_name_is_reported(tmp_path, name):
    """A name that is no UTF-8 is as Python reads it: \\xe9 is \\udce9."""
    case = next(case for case in CASES if case.verdict == "not_testable")
    write_data(tmp_path / name, case)
    found = diagnose(FINGER, read_measurements(tmp_path / name))
    content = write_report(found, FINGER, tmp_path / f"out {name}", str(tmp_path / name))
    folder = tmp_path / f"out {name}"
    assert content["data"]["file"] == name
    assert json.loads((folder / "report.json").read_text(encoding="utf-8")) == content
    assert (folder / "report.html").read_text(encoding="utf-8").startswith("<!")
    read_model(folder / "model.toml")


def test_a_model_with_the_effect_already_on_says_so(tmp_path):
    source = tmp_path / "d.csv"
    write_data(source, CASES[1])
    exponent = {"exponent": Parameter(0.7, "1", "known")}
    given: ModelDescription = replace(
        FINGER, effect_parameters={"load_dependent_friction": exponent}
    )
    with without_pictures():
        content = write_report(
            diagnose(given, read_measurements(source)), given, tmp_path / "out", "d.csv"
        )
    assert content["verdict"] == "no_discrepancy"
    assert {"name": "load_dependent_friction", "why": "already in the model"} in content[
        "not_tested"
    ]
    assert (
        read_model(tmp_path / "out" / "model.toml").effect_parameters["load_dependent_friction"]
        == exponent
    )


def test_a_fold_without_error_has_its_number_on_a_logarithmic_axis():
    """At an error of zero the number lay infinitely far below, and there was no room for bars."""
    errors = np.array([90.0, -2e-17])
    proof = Proof("block", ("1", "2"), np.array([4, 4]), errors, errors / 9.0, 0.9, (0.8, 1.0), 1.0)
    found = SimpleNamespace(proof=proof, chosen=SimpleNamespace(kinds=("one",), name="sweat_film"))
    drawn = held_out(found)
    drawn.canvas.draw()
    (ax,) = drawn.axes
    assert [text.get_text() for text in ax.texts] == ["90", "0.00", "10", "0.00"]
    assert ax.get_position().height > 0.4


def test_ticks_that_would_touch_are_left_out():
    levels = np.array([60, 75, 100, 120, 150, 200, 250, 330, 400, 500, 700, 1000.0])
    kept = np.array(_apart(levels))
    assert kept[0] == 60.0
    assert (np.diff(np.log(kept)) >= 0.14 * np.log(1000.0 / 60.0)).all()
    assert set(kept) <= set(levels)
    assert _apart(np.array([60.0, 1000.0])) == [60.0, 1000.0]


def test_more_than_all_of_a_gap_is_said_without_a_figure():
    assert gap_said(0.9, (0.5, 16.75)).endswith("(50 % to over 100 %)")
    assert gap_said(-0.2, (-584.0, 0.0)).endswith("(below -100 % to 0 %)")
