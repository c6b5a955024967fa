"""The safety file: its numbers by other ways to get them, its words, and the tests it names."""

from __future__ import annotations

import datetime
import json
from math import pi, sqrt
from pathlib import Path

import numpy as np
import pytest

from haptic_driver.lab.papers.currents import network_weight
from haptic_driver.lab.papers.mechanisms import MECHANISMS
from haptic_driver.lab.papers.safety import safety_file
from haptic_driver.lab.papers.safety_facts import inspect
from haptic_driver.lookup.models import load_model
from haptic_driver.rig.config import load_rig
from model.conditions import Conditions
from model.touch_model import TouchModel
from tests.haptic_driver.commands import said_by

ROOT = Path(__file__).resolve().parents[4]
TODAY = datetime.date(2026, 3, 1)


@pytest.fixture(scope="module")
def paper():
    return safety_file(inspect("paper", "reference", TODAY))


def rig_file(tmp_path: Path, *changes: tuple[str, str]) -> str:
    """The paper's rig with lines of its file replaced."""
    text = (ROOT / "configs/rigs/paper.toml").read_text(encoding="utf-8")
    for old, new in changes:
        assert text.count(old) == 1, old
        text = text.replace(old, new)
    path = tmp_path / "rig.toml"
    path.write_text(text, encoding="utf-8")
    return str(path)


def test_participants_are_told_this_rigs_own_figures(paper, tmp_path):
    out, consent = tmp_path / "safety.html", tmp_path / "consent.html"
    said_by("safety", "--rig", "paper", "--out", out, "--participants", consent)
    text = " ".join(consent.read_text(encoding="utf-8").split())
    worst = max(paper.facts["touch_currents"], key=lambda one: one["share"])
    shown = [
        f"at most {paper.facts['limits']['voltage_v']:g} V peak",
        f"at {worst['frequency_hz']:g} Hz; that is {worst['share']:.0%} of the limit",
        f"{paper.facts['limits']['lease_s']:g} s after the computer falls silent",
        "[where the emergency stop is]",
        "DRAFT",
        "signature",
    ]
    assert [words for words in shown if words not in text] == []


@pytest.mark.parametrize("test", [test for one in MECHANISMS for test in one.tests])
def test_every_test_that_it_names_is_there(test):
    file, _, name = test.partition("::")
    assert (ROOT / file).is_file(), f"{file} is gone"
    assert f"\ndef {name}(" in (ROOT / file).read_text(encoding="utf-8"), f"{file} has no {name}"


@pytest.mark.parametrize("frequency_hz", [15.0, 50.0, 1e3, 20e3, 1e6])
def test_the_network_by_its_nodes(frequency_hz):
    """1 A into the body network; nodes: after the body's skin, and over the capacitor."""
    s = 2j * pi * frequency_hz
    body, series, shunt = 1 / 500.0, 1 / 10e3, s * 0.022e-6
    node_v = np.linalg.solve(
        np.array([[body + series, -series], [-series, series + shunt]]), np.array([1.0, 0.0])
    )
    assert network_weight(np.array([frequency_hz]))[0] == pytest.approx(abs(node_v[1]) / 500.0)


def test_the_network_is_not_asked_where_it_is_not_meant():
    assert np.isnan(network_weight(np.array([10.0, 2e6]))).all()


def test_currents_are_those_of_the_full_model(paper):
    """Each row by `predict`, which knows neither limits nor the tables of the worst case."""
    rows = paper.facts["touch_currents"]
    f, v = (np.array([row[key] for row in rows]) for key in ("frequency_hz", "voltage_v"))
    touch = TouchModel(load_model("reference"))
    load = np.full(f.size, 0.5)
    answer = touch.predict(Conditions(f, v, load))
    stuck = np.array([row["stuck_a_rms"] for row in rows])
    assert stuck == pytest.approx(answer.stuck_current_rms_a, rel=1e-6)  # no load in the worst case
    sliding = np.array([row["sliding_a_rms"] for row in rows])
    heavy = touch.predict(Conditions(f, v, np.full(f.size, 2.0))).current_rms_a
    assert (sliding >= 0.999 * answer.current_rms_a).all()
    assert sliding == pytest.approx(heavy, rel=1e-3)  # current grows with load, to the axis' end


def test_the_limit_is_the_curve_of_the_file(paper):
    """0.5 mA to 2.5 kHz, 0.2 mA per kHz beyond."""
    for row in paper.facts["touch_currents"]:
        khz = row["frequency_hz"] / 1e3
        assert row["limit_a_rms"] == pytest.approx(1e-3 * max(0.5, 0.2 * khz))
        assert row["stuck_a_rms"] <= row["limit_a_rms"] * (1 + 1e-9)
        assert row["share"] == pytest.approx(row["stuck_a_rms"] / row["limit_a_rms"])


def test_a_measured_resistor_and_the_amplifier_bound_the_current(tmp_path):
    ohm = ("series_resistance_ohm = 0.0 ", "series_resistance_ohm = 1e6 ")
    rig = rig_file(tmp_path, ohm)
    facts = safety_file(inspect(rig, "reference", TODAY)).facts
    for row in facts["touch_currents"]:
        assert row["stuck_a_rms"] <= row["voltage_v"] / sqrt(2.0) / 1e6 * (1 + 1e-9)
        assert row["fault_a_rms"] <= 700.0 / sqrt(2.0) / 1e6 * (1 + 1e-9)
    little = ("current_limit_a = 0.1 ", "current_limit_a = 0.01 ")
    facts = safety_file(inspect(rig_file(tmp_path, little), "reference", TODAY)).facts
    assert facts["touch_currents"][-1]["fault_a_rms"] == pytest.approx(0.01 / sqrt(2.0))


def test_energy_stored(paper, tmp_path):
    stored = paper.facts["stored"]
    assert stored["energy_at_limit_j"] == pytest.approx(0.5 * 1e-9 * 150.0**2)
    assert stored["energy_at_fault_j"] == pytest.approx(0.5 * 1e-9 * 700.0**2)
    assert stored["charge_at_fault_c"] == pytest.approx(0.7e-6)
    unknown = rig_file(tmp_path, ("panel_capacitance_f = 1e-9 ", "panel_capacitance_f = 0.0 "))
    facts = safety_file(inspect(unknown, "reference", TODAY)).facts
    assert facts["stored"]["energy_at_limit_j"] is None


def test_what_is_unverified_stands_there(paper):
    facts = paper.facts
    assert {"limits.panel_capacitance_f", "amplifier.gain_v_per_v", "[amplifier]"} <= set(
        facts["unverified"]
    )
    assert "limits.voltage_v" not in facts["unverified"]
    unsigned = {one["section"] for one in facts["measured"] if not one["by"]}
    assert unsigned == {"limits", "amplifier"}
    assert len(facts["refuses_to_come_on"]) == 2


@pytest.mark.parametrize(
    ("date", "remark"), [("2026-02-01", ""), ("2024-01-01", "year"), ("2027-01-01", "to come")]
)
def test_a_date_is_looked_at(tmp_path, date, remark):
    who = ('measured_by = ""                      #', 'measured_by = "N. N."  #')
    when = ("# measured_at = 2025-01-31            #", f"measured_at = {date}  #")
    facts = safety_file(inspect(rig_file(tmp_path, who, when), "reference", TODAY)).facts
    found = next(one for one in facts["measured"] if one["section"] == "limits")
    assert (found["by"], found["on"]) == ("N. N.", date)
    assert remark in found["remark"]
    assert bool(remark) == bool(found["remark"])


def test_a_rig_with_and_without_what_protects_it(paper, tmp_path):
    def here(facts) -> dict[str, str | None]:
        return {one["mechanism"]: one["configured"] for one in facts["failures"]}

    assert here(paper.facts)["interlock"] is None
    assert here(paper.facts)["watchdog"] == "period 0.5 s"
    box = ('kind = "none"\n# kind = "box"\n# resource = "/dev', 'kind = "box"\nresource = "/dev')
    facts = safety_file(inspect(rig_file(tmp_path, box), "reference", TODAY)).facts
    assert here(facts)["interlock"] == "heartbeat box"
    assert any("cable pulled" in item for item in facts["checklist"])


def test_no_line_is_claimed_that_nobody_reads():
    """A simulated rig has a voltage monitor, and neither current monitor nor fault line."""
    rig = load_rig("simulated")
    assert rig.monitors == {"voltage monitor": "simulated"}
    configured = {one.name: one.here(rig) for one in MECHANISMS}
    assert configured["voltage monitor"]
    assert not configured["current monitor"]
    assert not configured["amplifier"]


def test_it_claims_nothing_and_says_whom_the_curve_is_not_for(tmp_path):
    said = said_by("safety", "--rig", "paper", "--out", tmp_path / "safety.html")
    text = (tmp_path / "safety.html").read_text(encoding="utf-8")
    assert "claims no conformity" in text
    assert "do not cover volunteers in research" in text
    assert text.count("not checked") >= 5
    assert said["conformity_claimed"] is False
    assert said["out"] == str(tmp_path / "safety.html")


def test_json_holds_the_facts_and_another_ending_is_refused(refuses, tmp_path):
    refuses("bad_ending", "safety", "--out", tmp_path / "safety.doc")
    assert not list(tmp_path.iterdir())
    said = said_by("safety", "--rig", "simulated", "--out", tmp_path / "safety.json")
    written = json.loads((tmp_path / "safety.json").read_text(encoding="utf-8"))
    assert {**written, "out": said["out"]} == said
    assert written["simulated"] is True
