"""A screen without a force sensor: load and friction as the electrode's current tells them."""

from __future__ import annotations

import re

import numpy as np
import pytest

from haptic_driver.config import find_config
from haptic_driver.daemon.current_sensor import CurrentSensor
from haptic_driver.daemon.daemon import Daemon
from haptic_driver.daemon.messages import RefusedError
from haptic_driver.daemon.set_up import DaemonSettings, render_settings
from haptic_driver.rig.config import load_rig
from haptic_driver.simulation.friction import friction_of, with_hidden
from haptic_driver.surface.models import load_model
from hw.errors import DeviceTimeout
from hw.monitor.contract import ElectrodeReading
from model.touch_model import TouchModel
from tests.haptic_driver.daemon.waiting import LEASE_S, keep_rendering
from tests.waiting import until

USUAL_N = 0.5
WETNESS = 1.2
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
    text = re.sub(r"sample_rate_hz = 20e3", "sample_rate_hz = 20e3\nrecord_s = 0.01", text) + WITHOUT
    text = f"{text}\n[simulation.hide]\nskin_hydration = {{ wetness = {WETNESS} }}\n"
    path = tmp_path / "without.toml"
    path.write_text(text)
    config = load_rig(str(path))
    return DaemonSettings(str(path), "reference", config, surface_file, render_settings(config, surface_file))


def test_feedback_goes_by_the_current_where_there_is_no_force_sensor(settings):
    finger = friction_of(with_hidden(TouchModel(load_model("reference")), {"skin_hydration": {"wetness": WETNESS}}))
    model = friction_of(TouchModel(load_model("reference")))
    with Daemon(settings) as daemon:
        lease = daemon.arm(LEASE_S)
        daemon.set_target(lease.token, 0.6)

        def felt():
            """Friction of the finger and of the model over the last second, both at the voltages put out."""
            made = daemon.samples(0, 1000)
            made = made[np.isfinite(made["measured_cof"]) & (made["voltage_v"] > 20.0)][::50]
            conditions = [(float(s["frequency_hz"]), float(s["voltage_v"]), USUAL_N, 0.02, 0.0) for s in made]
            return np.array([[law(*at) / USUAL_N for at in conditions] for law in (finger, model)])

        def settled():
            cof = felt()
            return cof.shape[1] > 5 and abs(cof[0].mean() / 0.6 - 1.0) < 0.5 * abs(cof[1].mean() / cof[0].mean() - 1.0)

        keep_rendering(daemon, lease.token, settled)
        status = daemon.status()
        assert "friction_from_current" in status.flags
        assert status.measured_cof is not None
        assert daemon.basis.observer.rows == type(daemon.basis.observer.rows)()
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
        assert (reading.normal_force_n, np.isnan(reading.lateral_force_n), reading.saturated) == (USUAL_N, True, False)
        assert set(told) == {200.0}
    finally:
        sensor.close()
