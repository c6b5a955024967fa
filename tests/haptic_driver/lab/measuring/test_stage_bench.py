"""Plans run on stage, generator, interlock and force box: by real drivers in real time over the
instruments' own wires, and by a stepped clock.
"""

from __future__ import annotations

import io
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from haptic_driver.cli.main import main
from haptic_driver.errors import HapticError
from haptic_driver.lab.measuring import stage_bench
from haptic_driver.lab.measuring.benches import bench_for
from haptic_driver.lab.measuring.check import check
from haptic_driver.lab.measuring.plan import Plan, Row, Setting
from haptic_driver.lab.measuring.run import prepare
from haptic_driver.lab.measuring.stage_bench import StageBench
from haptic_driver.lab.measuring.stroke import stroke
from haptic_driver.lab.strokes.file import read_strokes, strokes_path
from haptic_driver.rig.config import load_rig
from haptic_driver.simulation.hand import CARRIED_N
from haptic_driver.simulation.served import ServedRig
from haptic_driver.simulation.twin import as_real
from model.conditions import Conditions
from tests.haptic_driver.commands import rows_of
from tests.haptic_driver.config_texts import served_rig_text
from tests.haptic_driver.lab.refusal import refused
from tests.haptic_driver.stand_ins import living_rig

pytestmark = pytest.mark.timeout(300)

SPEED_M_S = 0.02
# The box takes its bias from one sample with 3 mN of noise: four times that.
BIAS_N = 0.012
DRIVEN = Setting(250.0, 75.0, CARRIED_N, SPEED_M_S)


@pytest.fixture
def served(config, model):
    with living_rig(config, model) as rig:
        yield rig


def plan(*settings: Setting, **changes: Any) -> Plan:
    """Averages twice as long as they must last: the machine may be busy."""
    short = Plan(
        name="short",
        settings=settings,
        randomise=False,
        voltage_off_every=1,
        settle_s=0.2,
        average_s=1.0,
        pause_s=0.0,
    )
    return short.model_copy(update=changes)


def off(served: ServedRig) -> bool:
    return (
        not served.generator.output().on
        and served.amplifier.voltage_v == 0.0
        and not served.stage.moving
    )


@pytest.fixture(scope="module")
def stepped(model):
    """On a simulated rig with a stage by a stepped clock, where the load is the finger's own."""
    by_hand = load_rig("simulated")
    own = {"load_stage": by_hand.load_stage, "camera": by_hand.camera}
    config = load_rig("simulated-paper").model_copy(update=own)
    with (
        pytest.MonkeyPatch.context() as patch,
        bench_for(prepare(config, model, plan(DRIVEN)), 0, None, lambda what: None) as bench,
    ):
        patch.setattr(stage_bench, "LOAD_WAIT_S", 0.6)
        bench.begin_session(1, 0.0)
        yield bench


def test_a_load_that_nobody_brings_is_asked_for_and_then_given_up(stepped, monkeypatch):
    told: list[str] = []
    monkeypatch.setattr(stepped, "_tell", told.append)
    stepped.world.simulated.asked_n = CARRIED_N
    heavy = DRIVEN._replace(normal_force_n=2.0 * CARRIED_N)
    with pytest.raises(HapticError) as error:
        StageBench.begin_row(stepped, 0, Row(heavy, 1, 1))
    assert error.value.code == "load_missed"
    said_n = re.search(r"the load is (\S+) N", error.value.message)
    assert said_n is not None
    assert float(said_n[1]) == pytest.approx(CARRIED_N, abs=0.02)  # six times its noise
    assert any("press with 1 N, now 0.5" in what for what in told)


def test_a_stage_that_rests_when_it_should_slide_is_told(stepped):
    stepped.begin_row(0, Row(DRIVEN, 1, 1))
    stepped._stage.stop()
    with refused("stage_rests", kind=HapticError):
        stepped.up_to_speed()


def test_a_stage_that_stops_before_the_row_is_over_is_told(stepped):
    stepped.begin_row(0, Row(DRIVEN, 1, 1))
    stepped.up_to_speed()
    stepped.step(0.1, CARRIED_N, SPEED_M_S)
    stepped._stage.stop()  # as its own panel does
    with refused("stroke_ended", kind=HapticError):
        stepped.end_row()


def test_a_row_that_was_cut_short_does_not_keep_the_next_attempt_from_moving(stepped):
    """The stage slid on, and `haptic measure` ended with "moves already"."""
    stepped.begin_row(0, Row(DRIVEN, 1, 1))
    stepped.up_to_speed()
    stepped.step(0.1, CARRIED_N, SPEED_M_S)
    assert stepped._stage.read_status().moving
    stepped.begin_row(0, Row(DRIVEN, 1, 1))
    stepped.up_to_speed()


def test_a_stage_of_another_scale_is_told(stepped):
    """It slides at half the speed that it was sent."""
    stepped.begin_row(0, Row(DRIVEN, 1, 1))
    stepped.up_to_speed()
    wanted_m_s, began = stepped._stroke
    stepped._stroke = 2.0 * wanted_m_s, began
    stepped.step(0.1, CARRIED_N, SPEED_M_S)
    with refused("stage_slipped", "not 40.00 mm/s", kind=HapticError):
        stepped.end_row()


def test_another_session_waits_for_the_finger_to_lift(stepped):
    stepped.world.simulated.asked_n = CARRIED_N
    with pytest.raises(HapticError, match="session 2: lift the finger"):
        stepped.begin_session(2, 0.0)


def test_what_the_stage_cannot_do_is_refused_before_anything_moves(config, model):
    real = as_real(config)
    fast, long = DRIVEN._replace(speed_m_s=0.06), DRIVEN._replace(speed_m_s=0.05)
    given = plan(DRIVEN, fast, long, settle_s=1.0, average_s=2.0)
    points, refusals = check(given.settings, given, real, model)
    assert list(points) == [DRIVEN]
    assert "faster than the stage may move, 50 mm/s" in refusals[0].reason
    # 0.05 m/s for 2.5 s of acceleration at 0.02 m/s2, 7.5 ms of rising voltage, and 1 + 2 + 1 s
    assert "a slide of 325 mm is longer than the stage's travel, 150 mm" in refusals[1].reason
    path = stroke(DRIVEN, given, real)
    assert path.start_m + path.end_m == pytest.approx(0.15)
    assert path.length_m == pytest.approx(0.02 * (1.0 + 0.0075 + 4.0))
    with refused("no_stage"):
        prepare(real.model_copy(update={"stage": None}), model, given)


# --- as it is typed
# --------------------------------------------------------------------------------------------------

PLAN = f"""
name = "short"
frequency_hz = 250.0
voltage_v = 75.0
normal_force_n = {CARRIED_N}
speed_m_s = {SPEED_M_S}
randomise = false
voltage_off_every = 1
settle_s = 0.2
average_s = 1.0  # twice the readings that are needed: the machine may be busy
pause_s = 0.0
"""
STAGE = """
[stage]
resource = "{stage}"
travel_m = [0.0, 0.07]
velocity_m_s = 0.05
acceleration_m_s2 = 0.05
velocity_limit_m_s = 0.05
acceleration_limit_m_s2 = 0.05
"""


@pytest.fixture
def typed(served, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    text = served_rig_text(served.endpoints) + STAGE.format(**served.endpoints)
    Path("mine.toml").write_text(text, encoding="utf-8")
    Path("short.toml").write_text(PLAN, encoding="utf-8")
    return ["measure", "--rig", "mine.toml", "--plan", "short.toml", "--out", "data.csv"]


@pytest.mark.realtime
def test_a_rigs_file_and_a_plan_are_all_it_takes(served, model, typed, capsys):
    """Each row is a stroke under its load, of which every record of the force box is kept."""
    assert main([*typed, "--yes"]) == 0
    out = capsys.readouterr().out
    assert "2 rows of plan 'short' on rig mine -> data.csv" in out
    assert "generator says off, amplifier disabled" in out
    assert off(served)
    assert served.amplifier.max_voltage_v == pytest.approx(75.0, rel=0.01)
    rows = rows_of(Path("data.csv"))
    assert [float(row["voltage_v"]) for row in rows] == [0.0, 75.0]
    conditions = Conditions(
        np.array([250.0, 250.0]),
        np.array([0.0, 75.0]),
        np.full(2, CARRIED_N),
        speed_m_s=np.full(2, SPEED_M_S),
    )
    cof = model.predict(conditions).cof
    assert cof[1] > 1.1 * cof[0]
    rise = float(rows[1]["cof"]) - float(rows[0]["cof"])
    assert rise == pytest.approx(cof[1] - cof[0], rel=0.05)
    strokes = read_strokes(strokes_path(Path("data.csv"))).strokes
    for row, expected, found in zip(rows, cof, strokes, strict=True):
        assert float(row["cof"]) == pytest.approx(expected, abs=BIAS_N / CARRIED_N)
        assert float(row["measured_normal_force_n"]) == pytest.approx(CARRIED_N, abs=BIAS_N)
        assert row["simulated"] == "false"
        samples, steady = found.samples, found.samples[found.samples["steady"] == 1]
        # the box sends a record each millisecond; the row itself reads one in five at most
        assert np.median(np.diff(samples["time_s"])) == pytest.approx(1e-3, rel=0.5)
        # of 1000, fewer on a busy machine; a row reads 200 at most
        assert steady.size > 250
        kept_cof = steady["lateral_force_n"].mean() / steady["normal_force_n"].mean()
        # the same window, other readings
        assert float(row["cof"]) == pytest.approx(kept_cof, rel=0.01)
        sliding = samples[samples["displacement_m"] > 0.0]
        assert np.median(sliding["velocity_m_s"]) == pytest.approx(SPEED_M_S, rel=0.02)
        assert samples["velocity_m_s"][0] < 0.5 * SPEED_M_S  # from rest


def test_without_anybody_there_nothing_begins(served, typed, capsys, monkeypatch):
    monkeypatch.setattr("sys.stdin", io.StringIO("y\n"))  # no terminal
    position_mm = served.stage.position_mm
    assert main(typed) == 2
    err = capsys.readouterr().err
    assert "up to 75 V peak" in err
    assert "--yes" in err
    assert not Path("data.csv").exists()
    assert served.stage.position_mm == position_mm


def test_nothing_can_be_hidden_in_a_real_finger(typed, capsys):
    Path("hide.toml").write_text("[series_resistance]\nresistance_ohm = 1e8\n", encoding="utf-8")
    assert main([*typed, "--yes", "--hide", "hide.toml"]) == 2
    assert "is real" in capsys.readouterr().err
