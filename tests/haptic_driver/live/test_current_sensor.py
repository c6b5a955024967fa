"""A screen without a force sensor: load and friction as the electrode's current tells them."""

from __future__ import annotations

import re

import numpy as np
import pytest

from haptic_driver.config import find_config
from haptic_driver.daemon.daemon import Daemon
from haptic_driver.daemon.messages import RefusedError
from haptic_driver.daemon.set_up import DaemonSettings, render_settings
from haptic_driver.live.current_sensor import (
    NOTHING_SEEN,
    Carried,
    ElectrodeWatch,
    TouchEstimate,
)
from haptic_driver.rig.config import load_rig
from hw.errors import DeviceError, DeviceTimeout
from hw.monitor.contract import ElectrodeReading
from tests.haptic_driver.daemon.waiting import LEASE_S, keep_rendering
from tests.waiting import until

USUAL_N = 0.5
SLIDING = Carried(200.0, slides=True)
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


@pytest.mark.realtime
def test_feedback_goes_by_the_current_where_there_is_no_force_sensor(settings):
    with Daemon(settings) as daemon:
        lease = daemon.arm(LEASE_S)
        daemon.targets.play(lease.token, "linen")

        def learnt():
            """That friction is estimated, at loads told by the current, and that feedback has
            learnt of it.
            """
            made = daemon.samples(0, 1000)
            told = np.isfinite(made["estimated_cof"]) & (made["normal_force_n"] != USUAL_N)
            return np.count_nonzero(told) > 5 and made["feedback_gain"][-1] != 1.0

        keep_rendering(daemon, lease.token, learnt)
        made, status = daemon.samples(0, 1000), daemon.status()
        assert np.isnan(made["measured_cof"]).all()
        assert np.isnan(made["lateral_force_n"]).all()
        assert np.nanmax(made["current_a"]) > 0.0
        assert "friction_from_current" in status.flags
        assert status.measured_cof is None
        assert len(daemon.basis.observer.rows) == 0
        with pytest.raises(RefusedError, match="estimated from the current"):
            daemon.adapt(True)


def test_without_a_reading_nothing_is_seen_and_a_failing_monitor_is_a_failing_sensor():
    answers = iter([DeviceTimeout("the monitor is silent", "look"), None])
    told = []

    def electrode(frequency_hz: float) -> ElectrodeReading | None:
        told.append(frequency_hz)
        answer = next(answers, None)
        if isinstance(answer, DeviceTimeout):
            raise answer
        return answer

    watch = ElectrodeWatch(electrode, lambda: SLIDING, estimate("reference"))
    watch.start()
    try:
        until(lambda: len(told) > 2)
        assert watch.newest() == NOTHING_SEEN
        assert set(told) == {200.0}
    finally:
        watch.close()


def estimate(model: str) -> TouchEstimate:
    return TouchEstimate(USUAL_N, 0.0, lambda: model)


def failing(frequency_hz: float) -> ElectrodeReading | None:
    raise DeviceTimeout("the monitor is silent", "look")


@pytest.mark.parametrize(
    ("watch", "words"),
    [
        (ElectrodeWatch(failing, lambda: SLIDING, estimate("reference")), "silent"),
        (ElectrodeWatch(lambda hz: None, lambda: SLIDING, estimate("gone")), "gone"),
    ],
)
def test_what_fails_is_told_and_not_a_silent_end(watch, words):
    def failed():
        try:
            watch.newest()
        except DeviceError as error:
            return error.message
        return None

    watch.start()
    try:
        assert words in until(failed)
    finally:
        watch.close()


def test_a_monitor_that_fails_beside_a_force_sensor_takes_nothing_away():
    watch = ElectrodeWatch(failing, lambda: SLIDING)
    with pytest.raises(DeviceTimeout):
        watch.look()
    assert watch.newest() == NOTHING_SEEN
