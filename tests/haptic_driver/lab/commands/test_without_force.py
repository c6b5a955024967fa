"""A simulated rig whose file says that there is no force sensor: `doctor`, `demo`, `measure`."""

from __future__ import annotations

import re

import numpy as np
import pytest

from haptic_driver.config import find_config, texture_dirs
from haptic_driver.daemon.set_up import render_settings
from haptic_driver.daemon.stepped import render_slide
from haptic_driver.errors import BadInputError
from haptic_driver.lab.measuring.bench import SimulatedBench
from haptic_driver.lab.measuring.plan import load_plan
from haptic_driver.lab.measuring.run import prepare
from haptic_driver.live.touch_by_current import LEVEL_STD
from haptic_driver.lookup.models import load_model
from haptic_driver.pictures.friction_pictures import draw_slide
from haptic_driver.render import feedback
from haptic_driver.rig.config import load_rig
from haptic_driver.rig.part import NoPart
from haptic_driver.rig.parts.force_sensors import NoForceSensorConfig
from haptic_driver.rig.slide import Slide, synthetic_slide
from haptic_driver.simulation.rig import SimulatedRig
from haptic_driver.textures.library import load_texture
from hw.monitor.contract import ElectrodeReading
from model.diagnosis.data import read_measurements
from model.touch_model import TouchModel
from tests.haptic_driver.cli.test_demo import trace

WITHOUT = '\n[force_sensor]\nkind = "none"\nload_n = 0.5\n'
PLAN = """
name = "small"
about = "for a test"
frequency_hz = [100]
voltage_v = [50, 75]
normal_force_n = [0.3, 0.5]
speed_m_s = [0.02]
repeats = 2
sessions = 1
voltage_off_every = 2
settle_s = 0.2
average_s = 0.25
"""


def rig(tmp_path, *, monitors: bool) -> str:
    text = find_config("simulated", "rigs").read_text(encoding="utf-8")
    if not monitors:
        tables = re.split(r"(?m)^(?=\[)", text)
        text = "".join(table for table in tables if not table.startswith("[[electrode_monitors"))
    path = tmp_path / "without.toml"
    path.write_text(text + WITHOUT, encoding="utf-8")
    return str(path)


def slide_of(path: str, surface_file):
    config, finger, whole = load_rig(path), load_model("reference"), synthetic_slide()
    columns = (whole.time_s, whole.position_m, whole.normal_force_n)
    first = Slide("stroke", *(column[:1800] for column in columns))
    settings = render_settings(config, surface_file)
    with SimulatedRig(config, TouchModel(finger), envelope=True) as bench:
        return render_slide(first, load_texture("linen", texture_dirs()), settings, bench)


@pytest.mark.parametrize("monitors", [False, True])
def test_friction_is_estimated_and_never_measured(surface_file, tmp_path, monitors):
    record = slide_of(rig(tmp_path, monitors=monitors), surface_file)
    samples = record.samples[record.sliding]
    assert samples.size > 400
    for name in ("measured_cof", "lateral_force_n"):
        assert np.isnan(record.samples[name]).all()
    # the finger is the model's own: what is off is what the load may do
    off = samples["estimated_cof"] / samples["target_cof"] - 1.0
    assert np.sqrt(np.mean(off**2)) < 0.15
    std = samples["estimated_cof_std"]
    read = np.isfinite(samples["current_a"])
    assert read.any() == monitors
    np.testing.assert_allclose(std[~read], LEVEL_STD * samples["estimated_cof"][~read])
    if monitors:
        alone = LEVEL_STD * samples["estimated_cof"][read]
        assert np.median(std[read] / alone) < 0.98  # of it the current tells the rise alone
    else:
        assert np.all(samples["feedback_gain"] == 1.0)
        assert np.all(samples["normal_force_n"] == 0.5)
        draw_slide(record, "linen", tmp_path / "slide.png")
        assert (tmp_path / "slide.png").read_bytes().startswith(b"\x89PNG")


def test_friction_without_voltage_is_not_learnt_where_nothing_shows_it():
    law = feedback.FeedbackSettings(0.01, off_share=0.0)
    gains, _ = feedback.taught(law, feedback.any_finger(law), (0.25, 0.10), 0.40, 0.01)
    assert gains.off == 1.0
    assert gains.rise > 1.0
    both = feedback.FeedbackSettings(0.01)
    gains, _ = feedback.taught(both, feedback.any_finger(both), (0.25, 0.10), 0.40, 0.01)
    assert gains.off > 1.0


@pytest.mark.process
def test_the_doctor_says_where_friction_comes_from(haptic, tmp_path):
    for monitors, words in ((True, "estimated from the electrode's current"), (False, "model's")):
        said = haptic("doctor", "--rig", rig(tmp_path, monitors=monitors), "--json").said
        (found,) = [check for check in said["checks"] if check["name"] == "force sensor"]
        assert found["status"] == "warning"
        assert words in found["message"]


def test_the_demo_says_that_nothing_was_measured(haptic, tmp_path):
    path = rig(tmp_path, monitors=False)
    words = ("--texture", "linen", "--trace", trace(tmp_path), "--out", tmp_path, "--json")
    done = haptic("demo", "--rig", path, *words)
    assert done.said["measured_cof"] is None
    assert done.said["share_within_5_percent"] is None
    assert done.said["estimated_cof_std"] == pytest.approx(LEVEL_STD * done.said["estimated_cof"])


def test_measuring_keeps_current_and_voltage_which_diagnose_takes(
    haptic, refuses, tmp_path, monkeypatch
):
    (tmp_path / "plan.toml").write_text(PLAN, encoding="utf-8")
    command = ["measure", "--plan", tmp_path / "plan.toml", "--out", tmp_path / "data.csv"]
    done = haptic(*command, "--rig", rig(tmp_path, monitors=True), "--json")
    assert done.said["rows"] == 4
    reasons = {refusal["reason"] for refusal in done.said["refused"]}
    assert reasons == {"no force sensor: only the load of the rig's file is known, 0.5 N"}
    data = read_measurements(tmp_path / "data.csv")
    assert data.has_current
    assert not data.of(0).any()
    assert data.columns["normal_force_n"].tolist() == [0.5] * data.count
    nothing = ElectrodeReading(0j, 0.0, 0j, 0.0)
    monkeypatch.setattr(SimulatedBench, "read_electrode", lambda bench, setting: nothing)
    again = (*command, "--force", "--rig")
    refuses("no_current", *again, rig(tmp_path, monitors=True), status=1)
    error = refuses("no_force_sensor", *again, rig(tmp_path, monitors=False))
    assert "[[electrode_monitors]]" in error["hint"]


def test_a_stage_whose_finger_nobody_feels_measures_nothing():
    """It would wait for a touch for ever."""
    stage = load_rig("simulated-paper").model_copy(update={"load_stage": NoPart()})
    blind = stage.model_copy(update={"force_sensor": NoForceSensorConfig(kind="none")})
    with pytest.raises(BadInputError, match="nobody tells when a finger presses"):
        prepare(blind, TouchModel(load_model("reference")), load_plan("witnesses"))
