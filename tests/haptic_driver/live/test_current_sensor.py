"""A screen without a force sensor: load and friction as the electrode's current tells them."""

from __future__ import annotations

import numpy as np
import pytest

from haptic_driver.daemon.daemon import Daemon
from haptic_driver.daemon.messages import RefusedError
from haptic_driver.daemon.set_up import DaemonSettings, render_settings
from haptic_driver.daemon.supervision import carried
from haptic_driver.live.current_sensor import NOTHING_SEEN, Carried, ElectrodeWatch, TouchEstimate
from haptic_driver.lookup.models import load_model
from haptic_driver.processes.samples import SAMPLE, Flag
from haptic_driver.rig.parts.force_sensors import NoForceSensorConfig
from hw.errors import DeviceError, DeviceTimeout
from hw.monitor.contract import ElectrodeReading
from model.conditions import Conditions
from model.touch_model import TouchModel
from tests.waiting import until

USUAL_N = 0.5
SLIDING = Carried(200.0, slides=True)


def test_without_a_force_sensor_it_is_flagged_and_no_model_is_refitted(rig_config, surface_file):
    """What is estimated then is in `lab/commands/test_without_force.py`."""
    without = NoForceSensorConfig(kind="none", stray_capacitance_f=300e-12)
    config = rig_config.model_copy(update={"force_sensor": without})
    render = render_settings(config, surface_file)
    assert Flag.FRICTION_FROM_CURRENT in Flag(render.standing_flags)
    daemon = Daemon(DaemonSettings("simulated", "reference", config, surface_file, render))
    try:
        with pytest.raises(RefusedError, match="estimated from the current"):
            daemon.adapt(True)
    finally:
        daemon.close()


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


@pytest.mark.parametrize("share", [0.5, 2.0])
def test_a_current_is_judged_for_the_area_that_the_screen_tells(share):
    """A touch of half the area lets half the current through: told so, nothing of it is odd."""
    usual = load_model("reference")
    area_m2 = share * usual.values.contact_area_m2
    finger = TouchModel(usual.with_values(contact_area_m2=area_m2))
    row = Conditions(*map(np.atleast_1d, (200.0, 80.0, USUAL_N)))
    there = finger.predict(row)
    voltage_v, current_a = (
        complex(x[0]) for x in (there.electrode_voltage_v, there.electrode_current_a)
    )
    reading = ElectrodeReading(voltage_v, 0.0, current_a, 1e-3 * abs(current_a))
    told = estimate("reference").of(0.0, SLIDING._replace(contact_area_m2=area_m2), reading)
    assert told.load_n == pytest.approx(USUAL_N, rel=1e-3)
    untold = estimate("reference").of(0.0, SLIDING, reading)
    assert abs(untold.load_n / USUAL_N - 1.0) > 0.02


def test_the_area_of_the_newest_tick_goes_with_the_carrier(shared):
    sample = np.zeros(1, SAMPLE)
    sample["in_contact"], sample["output_on"], sample["frequency_hz"] = 1, 1, 200.0
    sample["contact_area_m2"] = 1.5e-4
    shared.ring.write(sample[0].item())
    assert carried(shared).contact_area_m2 == 1.5e-4
