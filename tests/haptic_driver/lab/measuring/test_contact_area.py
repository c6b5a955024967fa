"""The contact area of a row: on a simulated rig with a camera, and on one without."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from haptic_driver.lab.measuring.bench import Scatter, SimulatedBench
from haptic_driver.lab.measuring.contact_area import contact_area
from haptic_driver.lab.measuring.plan import load_plan
from haptic_driver.lab.measuring.run import prepare
from haptic_driver.rig.config import load_rig
from haptic_driver.rig.part import NoPart
from haptic_driver.rig.parts.cameras import SimulatedCameraConfig
from hw.camera.contract import Frame
from hw.camera.fingerprint import Optics, Touch, drawn
from model.diagnosis.data import read_measurements
from tests.haptic_driver.commands import rows_of
from tests.haptic_driver.lab.measuring.test_run import hiding
from tests.haptic_driver.lab.measuring.test_run import measured as run_on

CAMERA = SimulatedCameraConfig(kind="simulated", frames=2, interval_s=0.12)
HIDDEN = {"contact_area_law": {"exponent": 0.5}}


def measured(out: Path, model, **changes: Any) -> list[dict[str, str]]:
    """Two loads, one of them without voltage too, by the finger that spreads under load."""
    config = hiding(load_rig("simulated"), HIDDEN).model_copy(update=changes)
    plan = load_plan("paper")
    first = next(s for s in plan.settings if s.driven)
    settings = tuple(first._replace(normal_force_n=n, frequency_hz=250.0) for n in (0.25, 1.0))
    short = {"repeats": 1, "sessions": 1, "settle_s": 0.2, "average_s": 0.3}
    plan = plan.model_copy(update={"settings": settings, **short})
    experiment = prepare(config, model, plan)
    still = Scatter(session_gain=0.0, session_area=0.0, area_wobble=0.0)
    bench = SimulatedBench(config, model, seed=3, scatter=still)
    run_on(experiment, out, bench=bench)
    return rows_of(out)


def test_a_rig_with_a_camera_writes_the_area(tmp_path, model):
    pytest.importorskip("skimage")
    rows = measured(tmp_path / "data.csv", model, camera=CAMERA)
    assert all("contact is dark: it stands out by" in row["doubts"] for row in rows)
    for row in rows:
        wanted_m2 = 1e-4 * (float(row["normal_force_n"]) / 0.5) ** 0.5
        assert float(row["contact_area_m2"]) == pytest.approx(wanted_m2, rel=0.03)
        assert 0.0 < float(row["contact_area_std_m2"]) < 0.05 * wanted_m2
    assert {row["normal_force_n"] for row in rows} == {"0.25", "1"}
    assert read_measurements(tmp_path / "data.csv").has_area


def test_a_rig_without_one_leaves_it_empty(tmp_path, model):
    rows = measured(tmp_path / "data.csv", model)
    assert {row["contact_area_m2"] for row in rows} == {""}
    assert not read_measurements(tmp_path / "data.csv").has_area


def test_what_contact_looks_like_is_guessed_or_as_the_rig_says():
    pytest.importorskip("skimage")
    optics = Optics(width=230, height=290, scale_m=45e-6, blur_m=15e-6)
    touch = drawn(Touch(5e-5), optics, np.random.default_rng(2))
    frames = [Frame(0.1, 255 - touch.image)]
    area = contact_area(frames, CAMERA)
    assert area is not None
    assert area.doubts.startswith("contact is bright: it stands out by")
    assert area.area_m2 == pytest.approx(touch.area_m2, rel=0.03)
    said = contact_area(frames, CAMERA.model_copy(update={"contact": "bright"}))
    assert said is not None
    assert (said.doubts, said.area_m2) == ("", area.area_m2)
    wrong = contact_area(frames, CAMERA.model_copy(update={"contact": "dark"}))
    assert wrong is None or "told to be dark: look at the outlines" in wrong.doubts


def test_frames_that_show_no_touch_give_no_area():
    pytest.importorskip("skimage")
    grey = np.full((120, 100), 180, np.uint8)
    assert contact_area([Frame(0.1, grey)], CAMERA) is None
    assert contact_area([], CAMERA) is None
    assert contact_area([Frame(0.1, grey)], NoPart()) is None
