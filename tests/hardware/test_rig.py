"""A real rig, named by the environment variable HAPTIC_HARDWARE; skipped without it.

    HAPTIC_HARDWARE=configs/rigs/mine.toml HAPTIC_ENERGISE=20 python -m pytest tests/hardware

Without HAPTIC_ENERGISE nothing is energised. With it, that many volts (peak, at the electrode) come
on for a moment: nobody touches the screen meanwhile, and the force sensor is unloaded.
On a rig with an envelope the carrier comes on, and the envelope stays at zero.
"""

import datetime
import os
import time

import pytest

from haptic_driver.rig.actuator import make_actuator
from haptic_driver.rig.check import CheckStatus
from haptic_driver.rig.config import load_rig
from haptic_driver.rig.devices import connect_devices
from haptic_driver.rig.doctor import examine
from haptic_driver.rig.states import RigState
from haptic_driver.signals import DriveCommand

RIG = os.environ.get("HAPTIC_HARDWARE")
VOLTAGE = os.environ.get("HAPTIC_ENERGISE")

pytestmark = [
    pytest.mark.process,
    pytest.mark.skipif(RIG is None, reason="set HAPTIC_HARDWARE to a rig's name or file"),
]


@pytest.fixture
def config():
    return load_rig(RIG)


def test_the_doctor_finds_nothing_wrong(config):
    failed = [
        check
        for check in examine(config, datetime.date.today())
        if check.status is CheckStatus.FAILED
    ]
    assert failed == []


def test_it_connects_with_its_output_off_and_its_sensors_answering(config):
    with connect_devices(config) as devices:
        assert devices.rig.state is RigState.OFF
        reading = devices.force_sensor.read()
        assert not reading.saturated
        assert abs(reading.normal_force_n) < config.finger.contact_off_n  # unloaded, after its bias
        if devices.tracker is not None:
            assert devices.tracker.read().time_s == pytest.approx(time.monotonic(), abs=1.0)


@pytest.mark.skipif(
    VOLTAGE is None, reason="set HAPTIC_ENERGISE to a voltage to energise the electrode"
)
def test_a_low_voltage_comes_on_and_goes_off_with_evidence(config):
    wanted = DriveCommand(config.controller.lowest_carrier_hz, float(VOLTAGE), True)
    with connect_devices(config) as devices:
        actuator = make_actuator(config, devices.rig)
        began_s = time.monotonic()
        while time.monotonic() - began_s < 1.0:
            actuator.command(time.monotonic(), wanted)
            time.sleep(0.001)
        assert devices.rig.state is RigState.ON
        assert devices.rig.off().on is False


@pytest.mark.skipif(
    VOLTAGE is None, reason="set HAPTIC_ENERGISE to a voltage to energise the electrode"
)
def test_output_that_is_not_refreshed_goes_off(config):
    with connect_devices(config) as devices:
        devices.rig.command(
            time.monotonic(),
            DriveCommand(config.controller.lowest_carrier_hz, float(VOLTAGE), True),
        )
        time.sleep(2.0 * config.safety.lease_s)
        devices.rig.watch(time.monotonic())
        assert devices.rig.state is RigState.OFF
