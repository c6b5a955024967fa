"""The one served rig: by the clock, under real drivers."""

import threading
from contextlib import closing

import pytest

from haptic_driver.rig.config import load_rig
from haptic_driver.rig.slide import synthetic_slide
from haptic_driver.simulation.finger_model import FingerLaws
from haptic_driver.simulation.served import STEP_S, ServedRig
from haptic_driver.simulation.twin import twin_of
from hw.finger.touch_screen import EvdevTouchScreen
from hw.force.net_ft import NetFt
from hw.monitor.simulated import ElectrodeState
from tests.waiting import until

pytestmark = pytest.mark.process

HALF = FingerLaws(
    lambda frequency_hz, voltage_v, load_n, *rest: 0.5 * load_n,
    lambda *condition: ElectrodeState(1e3, 0.0, 0.0),
)


@pytest.fixture(scope="module")
def served():
    twin, _ = twin_of(load_rig("template"))
    ended = threading.Event()
    with ServedRig(twin, HALF, synthetic_slide()) as rig:

        def live():
            while not ended.wait(STEP_S):
                rig.catch_up()

        world = threading.Thread(target=live)
        world.start()
        try:
            yield rig
        finally:
            ended.set()
            world.join()


def test_the_hand_lifts_the_finger_for_the_bias_of_whoever_connects(served):
    """The finger of the last to listen would have become the zero of the next."""
    for _ in range(2):
        with closing(NetFt(served.config.force_sensor.settings())) as box:
            box.open()
            box.take_bias()
            # the slide's load is 0.44 N to 0.56 N; a wrong zero would make it negative
            until(lambda box=box: 0.4 < box.read().normal_force_n < 0.6)


def test_a_touch_screen_s_own_driver_sees_the_finger_over_a_socket(served):
    section = served.config.finger_tracker
    screen = EvdevTouchScreen(section.device, section.touch_calibration())
    with closing(NetFt(served.config.force_sensor.settings())) as box, closing(screen):
        box.open()  # nobody slides where nobody listens
        screen.open()
        # the slide goes from 0 to 80 mm
        until(lambda: 0.03 < screen.read().position_x_m < 0.05, screen.read)
        assert screen.read().position_y_m == pytest.approx(0.03, abs=1e-4)  # counts are of 10 um
