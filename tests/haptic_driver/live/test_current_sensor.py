"""A screen without a force sensor: load and friction as the electrode's current tells them."""

from __future__ import annotations

import re

import numpy as np
import pytest

from haptic_driver.config import find_config
from haptic_driver.daemon.daemon import Daemon
from haptic_driver.daemon.messages import RefusedError
from haptic_driver.daemon.set_up import DaemonSettings, render_settings
from haptic_driver.live.current_sensor import CurrentSensor
from haptic_driver.rig.config import load_rig
from hw.errors import DeviceError, DeviceTimeout
from hw.monitor.contract import ElectrodeReading
from tests.haptic_driver.daemon.waiting import LEASE_S, keep_rendering
from tests.waiting import until

USUAL_N = 0.5
WITHOUT = """
[force_sensor]
kind = "none"
load_n = 0.5
stray_capacitance_f = 300e-12
"""


@pytest.fixture
def settings(surface_file, tmp_path):
    """A rig without a force sensor, under a finger that is moist."""
    text = find_config("simulated", "rigs").read_text()
    text = (
        re.sub(r"sample_rate_hz = 20e3", "sample_rate_hz = 20e3\nrecord_s = 0.01", text) + WITHOUT
    )
    text += "\n[simulation.hide]\nskin_hydration = { wetness = 1.2 }\n"
    path = tmp_path / "without.toml"
    path.write_text(text)
    config = load_rig(str(path))
    return DaemonSettings(
        str(path), "reference", config, surface_file, render_settings(config, surface_file)
    )


def test_feedback_goes_by_the_current_where_there_is_no_force_sensor(settings):
    with Daemon(settings) as daemon:
        lease = daemon.arm(LEASE_S)
        daemon.targets.set(lease.token, 0.6)

        def learnt():
            """That friction is known, at loads told by the current, and that feedback has learnt of
            it.
            """
            made = daemon.samples(0, 1000)
            told = np.isfinite(made["measured_cof"]) & (made["normal_force_n"] != USUAL_N)
            return np.count_nonzero(told) > 5 and made["feedback_gain"][-1] != 1.0

        keep_rendering(daemon, lease.token, learnt)
        assert "friction_from_current" in daemon.status().flags
        assert len(daemon.basis.observer.rows) == 0
        with pytest.raises(RefusedError, match="estimated from the current"):
            daemon.adapt(True)


def test_without_a_reading_the_load_is_the_usual_one_and_friction_unknown():
    answers = iter([DeviceTimeout("the monitor is silent", "look"), None])
    told = []

    def electrode(frequency_hz: float) -> ElectrodeReading | None:
        told.append(frequency_hz)
        answer = next(answers, None)
        if isinstance(answer, DeviceTimeout):
            raise answer
        return answer

    sensor = CurrentSensor(electrode, USUAL_N, 0.0, lambda: 200.0, lambda: "reference")
    sensor.start()
    try:
        until(lambda: len(told) > 2)
        reading = sensor.read()
        assert (reading.normal_force_n, np.isnan(reading.lateral_force_n), reading.saturated) == (
            USUAL_N,
            True,
            False,
        )
        assert set(told) == {200.0}
    finally:
        sensor.close()


def test_a_model_that_has_gone_is_told_and_not_a_silent_end():
    sensor = CurrentSensor(lambda hz: None, USUAL_N, 0.0, lambda: 200.0, lambda: "gone")

    def failed():
        try:
            sensor.read()
        except DeviceError as error:
            return error.message
        return None

    sensor.start()
    try:
        assert "gone" in until(failed)
    finally:
        sensor.close()
