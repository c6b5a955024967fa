"""`haptic load` on the served rig, by its drivers; a rig without a load stage is refused."""

from __future__ import annotations

import datetime
import tomllib
from pathlib import Path
from typing import Any

import pytest

from haptic_driver.rig.claims import Claims
from haptic_driver.rig.config import load_rig
from haptic_driver.rig.load_loop import LoadLoop
from haptic_driver.rig.parts.load_stages import LoadStageSection
from haptic_driver.simulation.twin import LOAD_STAGE
from hw.force.net_ft import NetFt
from hw.force.sensor import ForceReading
from tests.haptic_driver.config_texts import CONFIGS, changed, served_rig_text
from tests.haptic_driver.stand_ins import living_rig

pytestmark = pytest.mark.timeout(300)

SECTION = f"""
[load_stage]
kind = "lts150"
resource = "{{load_stage}}"
travel_m = [0.0, 0.15]
higher_presses = true
clear_m = {LOAD_STAGE.clear_m}
when_wrong = "retract"
"""


@pytest.fixture
def served(rig_config, touch):
    with living_rig(rig_config, touch) as rig:
        yield rig


def said(outcome: Any) -> dict[str, Any]:
    told: dict[str, Any] = outcome.said
    return told


@pytest.fixture
def rig(served, tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text(served_rig_text(served.endpoints) + SECTION.format(**served.endpoints))
    return str(path)


@pytest.mark.realtime
def test_a_load_is_held_and_the_finger_lifted(haptic, rig, served):
    held = said(haptic("load", "hold", "0.5", "--rig", rig, "--seconds", "0.5", "--yes", "--json"))
    assert "mean_load_n" in held, held
    assert held["mean_load_n"] == pytest.approx(0.5, rel=0.1)
    assert held["depth_m"] > LOAD_STAGE.face_m
    assert served.load_stage.position_mm < 1e3 * LOAD_STAGE.face_m
    assert not served.load_stage.moving
    assert not served.generator.output().on


def test_a_gains_file_that_is_none_is_refused(haptic, rig, tmp_path):
    path = Path(rig)
    path.write_text(path.read_text() + 'gains_file = "gains.toml"\n')
    (tmp_path / "gains.toml").write_text("stiffness_n_per_m = -3\n")
    outcome = said(haptic("load", "hold", "0.5", "--rig", rig, "--yes", "--json"))
    assert "gains.toml" in outcome["error"]["message"]


def test_where_another_program_has_the_rig_it_says_what_to_do(refuses, rig):
    claims = Claims(load_rig(rig).addresses)  # as a daemon has them
    claims.take()
    error = refuses("in_use", "load", "hold", "0.5", "--rig", rig, "--yes", status=1)
    claims.release()
    assert "--socket" in error["hint"]


def test_what_cannot_be_held_is_refused(refuses):
    refuses("no_load_stage", "load", "hold", "0.5", "--rig", "simulated", "--yes")
    refuses("usage", "load", "tune", "--by", " ", "--yes")
    refuses("out_of_range", "load", "hold", "0.5", "--seconds", "-1", "--yes")


@pytest.mark.parametrize("load", ["3.5"])
def test_a_load_beyond_the_limits_moves_nothing(refuses, rig, served, load):
    refuses("bad_load", "load", "hold", load, "--rig", rig, "--yes")
    assert served.load_stage.position_mm == 1e3 * LOAD_STAGE.clear_m


def test_a_load_whose_zero_moved_meanwhile_is_in_doubt(refuses, monkeypatch):
    settle, read, off_n = LoadLoop.settle, NetFt.read, []

    def moved(sensor: NetFt) -> ForceReading:
        reading = read(sensor)
        return reading._replace(normal_force_n=reading.normal_force_n - sum(off_n))

    def settled(loop: LoadLoop, timeout_s: float) -> None:
        settle(loop, timeout_s)
        off_n.append(0.2)

    monkeypatch.setattr(NetFt, "read", moved)
    monkeypatch.setattr(LoadLoop, "settle", settled)
    refuses("load_in_doubt", "load", "hold", "0.5", "--seconds", "2", status=1)


def test_a_simulated_rig_holds_by_its_file_alone(haptic):
    """Half a newton on a finger of 1 N at 1.75 mm of which a quarter fades is 1.3 to 1.5 mm deep;
    its skin is at 12 mm.
    """
    held = said(haptic("load", "hold", "0.5", "--seconds", "20", "--json"))
    assert "mean_load_n" in held, held
    assert held["mean_load_n"] == pytest.approx(0.5, rel=0.03)
    assert 13e-3 < held["depth_m"] < 13.6e-3


def test_tuning_writes_down_what_the_next_loop_takes(haptic, tmp_path):
    """The body's tissue has 630 to 740 N/m at 0.5 N, relaxed and at once."""
    text = (CONFIGS / "rigs" / "simulated-paper.toml").read_text(encoding="utf-8")
    rig = tmp_path / "mine.toml"
    stiffness = "stiffness_n_per_m = 700.0\n"
    rig.write_text(changed(text, (stiffness, f'{stiffness}gains_file = "gains.toml"\n')))
    section = load_rig(str(rig)).load_stage
    assert isinstance(section, LoadStageSection)
    assert section.loop(0.5).stiffness_n_per_m == 700.0
    found = said(haptic("load", "tune", "--rig", rig, "--by", 'A "B" C', "--json"))
    assert found["out"] == str(tmp_path / "gains.toml")
    lines = tomllib.loads((tmp_path / "gains.toml").read_text())
    assert (lines["tuned_by"], lines["tuned_at"]) == ('A "B" C', datetime.date.today())
    assert 500.0 < lines["stiffness_n_per_m"] < 1000.0
    assert section.loop(0.5).stiffness_n_per_m == lines["stiffness_n_per_m"]
