from __future__ import annotations

import math
import threading
import time

import numpy as np
import pytest

from haptic_driver.signals import FingerSample
from hw.errors import DeviceDisconnected, DeviceTimeout
from hw.finger.tracker import FingerReading, RecordedFinger, StageFinger
from hw.serving.memory import MemoryTransport
from hw.stage.lts150 import Lts150, StageSettings, StageStatus
from hw.stage.simulated import SimulatedLts150
from tests.clock import ManualClock


def test_readings_map_onto_the_samples_of_the_driver():
    fields = FingerReading._fields
    assert fields[:3] == FingerSample._fields[:3]


def test_a_stage_carries_the_finger():
    clock = ManualClock(1000.0)
    instrument = SimulatedLts150(clock)
    settings = StageSettings(0.0, 0.15, 0.02, 0.02, 0.05, 0.05)
    stage = Lts150(
        MemoryTransport(instrument, clock=clock), settings, clock=clock, sleep=clock.sleep
    )
    stage.connect()
    before = StageFinger(stage.read_status, origin_m=(0.01, 0.02), clock=clock)
    with before:
        reading = before.read()
        assert reading.touching is False
        assert math.isnan(reading.position_x_m)
    stage.home()
    stage.wait(60.0)
    stage.move_to(0.05)
    stage.wait(60.0)
    with StageFinger(
        stage.read_status, origin_m=(0.01, 0.02), direction=(0.6, -0.8), clock=clock
    ) as finger:
        assert finger.read()[1:4] == (pytest.approx(0.04), pytest.approx(-0.02), True)


def test_a_stage_in_motion_is_followed():
    positions = iter(np.arange(0.0, 1.0, 1e-4))
    asked = threading.Event()

    def read_status() -> StageStatus:
        position_m = float(next(positions))
        if position_m > 0.001:
            asked.set()
        return StageStatus(time.monotonic(), position_m, True, True, False)

    with StageFinger(read_status, origin_m=(0.0, 0.0), interval_s=0.001) as finger:
        assert asked.wait(20.0)
        assert finger.read().position_x_m >= 0.001


def test_a_stage_that_fails_or_falls_silent_is_an_error():
    clock = ManualClock(1000.0)
    failing = threading.Event()
    failed = threading.Event()

    def read_status() -> StageStatus:
        if failing.is_set():
            failed.set()
            raise DeviceDisconnected("the stage is gone", "plug it in")
        return StageStatus(1000.0, 0.05, False, True, False)

    with StageFinger(read_status, origin_m=(0.0, 0.0), interval_s=0.001, clock=clock) as finger:
        assert finger.read().touching
        clock.sleep(0.3)
        with pytest.raises(DeviceTimeout, match="no position for"):
            finger.read()
        failing.set()
        assert failed.wait(20.0)
    with pytest.raises(DeviceDisconnected, match="the stage is gone"):
        finger.read()


def test_a_stage_finger_that_was_not_started_is_an_error():
    with pytest.raises(DeviceTimeout, match="no position"):
        StageFinger(lambda: StageStatus(0.0, 0.0, False, True, False), origin_m=(0.0, 0.0)).read()
    with pytest.raises(ValueError, match="unit vector"):
        StageFinger(
            lambda: StageStatus(0.0, 0.0, False, True, False),
            origin_m=(0.0, 0.0),
            direction=(1.0, 1.0),
        )


def test_a_recording_is_played_from_the_first_reading_on():
    clock = ManualClock(1000.0)
    finger = RecordedFinger(
        np.array([5.0, 5.1, 5.2]),
        np.array([0.01, 0.02, 0.03]),
        np.array([0.0, 0.0, 0.001]),
        np.array([False, True, True]),
        clock=clock,
    )
    clock.sleep(50.0)
    assert finger.read() == FingerReading(1050.0, 0.01, 0.0, False)
    clock.sleep(0.15)
    assert finger.read()[:4] == (pytest.approx(1050.1), 0.02, 0.0, True)
    clock.sleep(0.04)
    assert finger.read()[:4] == (pytest.approx(1050.1), 0.02, 0.0, True)
    clock.sleep(10.0)
    assert finger.read()[:4] == (clock(), 0.03, 0.001, False)


@pytest.mark.parametrize(("times", "count"), [([0.0, 0.0], 2), ([0.0, math.nan], 2), ([], 0)])
def test_what_is_no_recording_is_refused(times, count):
    column = np.zeros(count)
    with pytest.raises(ValueError, match="recording"):
        RecordedFinger(np.array(times), column, column, column.astype(bool))
