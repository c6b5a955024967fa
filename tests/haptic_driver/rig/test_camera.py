"""The section `[camera]` of a rig's file, and what a camera that is not there says."""

from __future__ import annotations

import datetime

import pytest

from haptic_driver.rig.check import Check, CheckStatus, Examination
from haptic_driver.rig.config import RigConfig, load_rig
from haptic_driver.rig.part import Wiring
from haptic_driver.rig.parts.cameras import GenicamCameraConfig
from hw.camera.simulated import Burst, Finger, SimulatedCamera
from hw.errors import DeviceError


def test_a_genicam_camera_that_is_not_there_says_so():
    """Whether or not `harvesters` is installed: no path of a producer is right here."""
    section = GenicamCameraConfig(kind="genicam", producer="gone.cti", scale_m_per_pixel=2e-5)
    part = section.make(Wiring())
    with pytest.raises(DeviceError, match=r"gone\.cti|package") as caught:
        part.device.open()
    assert caught.value.hint
    with pytest.raises(DeviceError, match="not open"):
        part.device.start()
    part.device.close()


def test_a_burst_has_the_frames_that_there_was_time_for():
    fingers = iter([Finger(5.0, 8e-5, 0.0), Finger(5.25, 8e-5, 0.0)])
    camera = SimulatedCamera(lambda: next(fingers), burst=Burst(3, 0.1))
    camera.start()
    assert [frame.time_s for frame in camera.frames()] == pytest.approx([0.1, 0.2])


def checks_of(config: RigConfig) -> list[Check]:
    at = Examination("camera", config, datetime.date(2024, 6, 1))
    return list(at.told(config.camera.examine))


def test_doctor_says_that_a_camera_does_not_answer():
    section = GenicamCameraConfig(kind="genicam", producer="gone.cti", scale_m_per_pixel=2e-5)
    config = load_rig("simulated").model_copy(update={"camera": section})
    (check,) = checks_of(config)
    assert (check.name, check.status) == ("camera", CheckStatus.FAILED)
    assert check.hint
    assert checks_of(load_rig("simulated")) == []
