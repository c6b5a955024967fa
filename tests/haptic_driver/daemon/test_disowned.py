"""A reading that cannot be true stands in the record of whose it is."""

from types import SimpleNamespace

import pytest

from haptic_driver.daemon.readings import Readings
from haptic_driver.rig.config import load_rig
from hw.errors import NotBelieved
from hw.finger.tracker import FingerReading
from hw.force.sensor import ForceReading
from hw.health import FORCE, READ, with_health
from tests.clock import ManualClock

FINGER = FingerReading(0.0, 0.03, 0.02, True)
WRONG = {
    "finger_tracker": ({"position_x_m": 5.0}, "puts the finger at x 5 m"),
    "force_sensor": ({"normal_force_n": 500.0}, "reads a normal force of 500 N"),
}


@pytest.mark.parametrize("name", WRONG)
def test_what_cannot_be_true_is_missed_until_the_next_that_can(name):
    clock = ManualClock()
    says = {"finger_tracker": FINGER, "force_sensor": ForceReading(0.0, 0.5, 0.3, False)}
    devices = {
        key: with_health(SimpleNamespace(read=lambda key=key: says[key]), key, asking, clock)
        for key, asking in (("finger_tracker", READ), ("force_sensor", FORCE))
    }
    readings = Readings(
        load_rig("simulated"),
        devices["finger_tracker"].read,
        devices["force_sensor"].read,
        clock,
        lambda key, said: devices[key].keeper.disown(said),
    )
    readings.read()
    good, (change, said) = says[name], WRONG[name]
    says[name] = good._replace(**change)
    with pytest.raises(NotBelieved):
        readings.read()
    assert said in devices[name].health.wrong
    assert [device.health.missed for device in devices.values()] == [
        int(key == name) for key in devices
    ]
    says[name] = good
    readings.read()
    assert (devices[name].health.missed, devices[name].health.wrong) == (1, "")
