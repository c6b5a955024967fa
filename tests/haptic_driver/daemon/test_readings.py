"""Readings that cannot be true are not believed, and take the output to zero as a fault that says
what and where.
"""

import math
import time

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptic_driver.daemon.messages import DaemonState
from haptic_driver.daemon.readings import SLACK_S, Readings, not_covered
from haptic_driver.daemon.render_process import _finger_sample
from haptic_driver.daemon.set_up import render_settings
from haptic_driver.daemon.stepped import SteppedDaemon
from haptic_driver.limits import OperatingLimits
from haptic_driver.render.texture import Uniform
from haptic_driver.rig.config import ScreenConfig, load_rig
from haptic_driver.rig.parts.force_sensors import NetFtForceSensorConfig, NoForceSensorConfig
from haptic_driver.simulation.rig import SimulatedRig
from hw.errors import NotBelieved
from hw.finger.tracker import FingerReading
from hw.force.sensor import ForceReading, NoForceSensor
from tests.haptic_driver.daemon.waiting import LEASE_S, keep_rendering, reset
from tests.waiting import until

DAEMON_RIG = "simulated"
NOW_S = 1000.0
SCREEN = ScreenConfig(width_m=0.10, height_m=0.06, margin_m=0.01)
FINGER = FingerReading(NOW_S, 0.03, 0.02, True)
FORCE = ForceReading(NOW_S, 0.5, 0.3, False)
ANY = st.floats(allow_nan=True, allow_infinity=True)


class Bench:
    """What two sensors say, and the clock."""

    def __init__(self, **sections):
        self.finger, self.force, self.now_s = FINGER, FORCE, NOW_S
        config = load_rig(DAEMON_RIG).model_copy(update={"screen": SCREEN} | sections)
        self.readings = Readings(
            config, lambda: self.finger, lambda: self.force, lambda: self.now_s
        )

    def says(self, finger=FINGER, force=FORCE):
        self.finger, self.force = finger, force
        return self.readings.read()

    def fault(self, **said):
        with pytest.raises(NotBelieved) as error:
            self.says(**said)
        assert error.value.code == "not_believed"
        assert error.value.hint
        return error.value.message


def test_a_good_reading_is_taken_as_it_is_and_may_be_repeated():
    bench = Bench()
    first = bench.says()
    assert first[:8] == (NOW_S, 0.03, 0.02, True, NOW_S, 0.5, 0.3, False)
    bench.now_s += 0.05
    assert bench.says() == first


def test_how_many_touch_is_passed_on():
    bench = Bench()
    assert math.isnan(bench.says().contacts)
    sensed = bench.says(FINGER._replace(contacts=3, palm=True))
    assert (sensed.contacts, sensed.palm) == (3.0, True)


@pytest.mark.parametrize("told", [(-1e-5, 1e-6), (0.02, 1e-3), (math.inf, 1.0), (1e-4, math.nan)])
def test_an_area_that_no_touch_has_or_without_its_error_is_not_believed(told):
    area_m2, std_m2 = told
    finger = FINGER._replace(contact_area_m2=area_m2, contact_area_std_m2=std_m2)
    assert "tells a contact area of" in Bench().fault(finger=finger)


def test_an_area_goes_on_with_its_error_and_ends_with_the_touch():
    """A touch that begins, with one count of area, was a fault."""
    finger = FINGER._replace(contact_area_m2=1.2e-4, contact_area_std_m2=2e-5)
    sensed = Bench().says(finger)
    assert (sensed.contact_area_m2, sensed.contact_area_std_m2) == (1.2e-4, 2e-5)
    assert _finger_sample(sensed, NOW_S).contact_area_m2 == 1.2e-4
    for none in (finger._replace(touching=False), finger._replace(contact_area_m2=8e-7)):
        assert math.isnan(Bench().says(none).contact_area_m2)


@pytest.mark.parametrize(
    ("touching_m2", "contacts", "palm", "why"),
    [
        (0.0, math.nan, False, None),
        (100e-6, 1, False, None),
        (100e-6, 2, False, "2 fingers touch the screen, more than 1"),
        (471e-6, 4, False, None),
        (471e-6, 5, False, "5 fingers touch the screen, more than 4"),
        (684e-6, 1, True, "a palm lies on the screen, up to 9000 mm²"),
        (9e-3, 6, True, None),
    ],
)
def test_contact_that_the_rigs_figure_does_not_cover_has_a_reason(touching_m2, contacts, palm, why):
    limits = OperatingLimits(150.0, 1.0, 1e6, touching_area_m2=touching_m2)
    sensed = Bench().says()._replace(contacts=contacts, palm=palm)
    found = not_covered(sensed, limits, 100e-6)
    assert found is None if why is None else found.startswith(why)


@pytest.mark.parametrize(
    ("touching_m2", "told", "why"),
    [
        (0.0, (190e-6, 40e-6), "a touch covers 190 mm² of the screen"),  # 110 mm² at the least
        (0.0, (170e-6, 40e-6), None),
        (471e-6, (190e-6, 40e-6), None),
        (0.0, (math.nan, math.nan), None),
    ],
)
def test_a_touch_that_is_surely_larger_than_the_figure_has_a_reason(touching_m2, told, why):
    limits = OperatingLimits(150.0, 1.0, 1e6, touching_area_m2=touching_m2)
    area_m2, std_m2 = told
    sensed = Bench().says()._replace(contact_area_m2=area_m2, contact_area_std_m2=std_m2)
    found = not_covered(sensed, limits, 100e-6)
    assert found is None if why is None else found.startswith(why)


@pytest.mark.parametrize(
    "wrong_s", [math.nan, math.inf, -math.inf, 1.7e9, NOW_S + 0.02, NOW_S - 0.02]
)
def test_a_time_is_between_the_last_one_and_now(wrong_s):
    """A sensor that stamped by the clock of the day and froze left 111 V on for ever, a tracker 71
    V.
    """
    bench = Bench()
    bench.says()
    assert "finger tracker (simulated)" in bench.fault(finger=FINGER._replace(time_s=wrong_s))
    assert "force sensor (simulated)" in bench.fault(force=FORCE._replace(time_s=wrong_s))


def test_a_frozen_clock_that_is_a_little_ahead_grows_old():
    bench = Bench()
    ahead = FORCE._replace(time_s=NOW_S + 0.9 * SLACK_S)
    assert bench.says(force=ahead).force_time_s == NOW_S
    for _ in range(100):
        bench.now_s += 0.01
        bench.says(FINGER._replace(time_s=bench.now_s), ahead)
    assert (
        bench.says(force=ahead, finger=FINGER._replace(time_s=bench.now_s)).force_time_s
        <= NOW_S + SLACK_S
    )


@given(
    finger_s=st.lists(ANY, min_size=3, max_size=6), force_s=st.lists(ANY, min_size=6, max_size=6)
)
def test_times_that_get_through_are_in_order_and_not_ahead(finger_s, force_s):
    bench, last = Bench(), (-math.inf, -math.inf)
    for one_s, other_s in zip(finger_s, force_s, strict=False):
        try:
            found = bench.says(FINGER._replace(time_s=one_s), FORCE._replace(time_s=other_s))
        except NotBelieved:
            continue
        assert last[0] <= found.finger_time_s <= NOW_S
        assert last[1] <= found.force_time_s <= NOW_S
        last = found.finger_time_s, found.force_time_s


@pytest.mark.parametrize("wrong_n", [500.0, -500.0, 1e30, 1e9, math.nan, math.inf])
def test_a_force_is_one_that_the_sensor_can_measure(wrong_n):
    said = Bench().fault(force=FORCE._replace(normal_force_n=wrong_n))
    assert (
        said
        == f"the force sensor (simulated) reads a normal force of {wrong_n:.4g} N, and measures up"
        " to 50 N"
    )
    assert "a lateral force of" in Bench().fault(force=FORCE._replace(lateral_force_n=wrong_n))


def test_what_it_can_measure_stands_in_the_rigs_file():
    axes = {
        "normal_axis": "-z",
        "lateral_axis": "x",
        "counts_per_n": 1e6,
        "counts_per_n_m": 1e6,
        "host": "box",
    }
    section = NetFtForceSensorConfig(
        kind="net_ft", **axes, normal_range_n=17.0, lateral_range_n=12.0
    )
    bench = Bench(force_sensor=section)
    assert (
        bench.says(
            force=FORCE._replace(normal_force_n=-17.0, lateral_force_n=-12.0)
        ).lateral_force_n
        == -12.0
    )
    assert "the force sensor (net_ft) reads a normal force" in bench.fault(
        force=FORCE._replace(normal_force_n=17.1)
    )
    assert "and measures up to 12 N" in bench.fault(force=FORCE._replace(lateral_force_n=12.1))


def test_what_a_sensor_disowns_or_nobody_measures_is_no_fault():
    disowned = FORCE._replace(normal_force_n=1e3, lateral_force_n=math.nan, saturated=True)
    assert Bench().says(force=disowned).saturated
    bench = Bench(force_sensor=NoForceSensorConfig(kind="none"))
    assert math.isnan(bench.says(force=NoForceSensor(0.5, lambda: NOW_S).read()).lateral_force_n)


@pytest.mark.parametrize(
    "place_m", [(5.0, 0.02), (0.111, 0.02), (-0.011, 0.02), (0.03, 0.071), (math.nan, 0.02)]
)
def test_a_finger_is_on_the_screen(place_m):
    x_m, y_m = place_m
    off = FINGER._replace(position_x_m=x_m, position_y_m=y_m)
    assert "on a screen of 0.1 m by 0.06 m" in Bench().fault(finger=off)
    assert (
        not Bench().says(finger=off._replace(touching=False)).touching
    )  # of such a one nothing is rendered


@pytest.mark.parametrize("place_m", [(0.0, 0.0), (0.109, 0.069), (-0.009, -0.009)])
def test_a_finger_at_the_edge_is_believed(place_m):
    x_m, y_m = place_m
    assert Bench().says(finger=FINGER._replace(position_x_m=x_m, position_y_m=y_m)).touching


# --- in simulated time, and in the daemon
# ------------------------------------------------------------------------


def slide_to(daemon, position_m):
    for _ in range(100):  # the screen tells at its own rate
        daemon.tick(position_m, 0.5, 0.0)


def test_a_demo_goes_by_the_same_check(rig_config, touch, surface_file):
    with SimulatedRig(rig_config, touch) as bench:
        daemon = SteppedDaemon(render_settings(rig_config, surface_file), bench, Uniform(0.6))
        try:
            daemon.connect()
            daemon.tick(0.03, 0.5, 0.0)
            assert daemon.shared.sensed.read().touching
            slide_to(daemon, 0.04)
            with pytest.raises(NotBelieved, match="puts the finger at x 5 m"):
                slide_to(daemon, 5.0)
        finally:
            bench.rig.off()
            daemon.close()


class Plugin:
    """A sensor of somebody else's, over the rig's own: from `wrong` on it says that instead, or
    raises it.
    """

    def __init__(self, own):
        self.own, self.wrong = own, None

    def __call__(self):
        if self.wrong is None:
            return self.own()
        if isinstance(self.wrong, BaseException):
            raise self.wrong
        return self.wrong(self.own())


@pytest.fixture
def plugins(daemon, monkeypatch):
    readings = daemon.supervisor.instruments._readings
    force, finger = Plugin(readings.read_force), Plugin(readings._read_finger)
    monkeypatch.setattr(readings, "read_force", force)
    monkeypatch.setattr(readings, "_read_finger", finger)
    return {"force": force, "finger": finger}


def frozen_by_the_clock_of_the_day(plugin):
    frozen = plugin.own()._replace(time_s=time.time())
    return lambda reading: frozen


WRONG = {
    "stamps by the clock of the day and freezes": frozen_by_the_clock_of_the_day,
    "has no time": lambda plugin: lambda reading: reading._replace(time_s=math.nan),
}
WRONG_OF = {
    "force": {
        "presses with 500 N": lambda plugin: lambda reading: reading._replace(normal_force_n=500.0)
    },
    "finger": {
        "is at 5 m": lambda plugin: (
            lambda reading: reading._replace(position_x_m=5.0, touching=True)
        )
    },
}
# The others are told from good ones by the same check, above, where no daemon is needed.
CASES = [("force", "presses with 500 N"), ("finger", "stamps by the clock of the day and freezes")]


def render(daemon, history):
    lease = daemon.arm(LEASE_S)
    daemon.targets.set(lease.token, 0.65)
    keep_rendering(daemon, lease.token, lambda: history()[-1][1] > 10.0)


@pytest.mark.process
@pytest.mark.parametrize(("which", "what"), CASES)
def test_what_cannot_be_is_a_fault_with_the_output_off(daemon, history, plugins, which, what):
    render(daemon, history)
    plugins[which].wrong = (WRONG | WRONG_OF[which])[what](plugins[which])
    until(lambda: daemon.status().state is DaemonState.FAULT, daemon.status)
    status = daemon.status()
    assert {"force": "the force sensor (simulated)", "finger": "the finger tracker (simulated)"}[
        which
    ] in status.fault
    assert "fault" in status.flags
    until(lambda: daemon.status().output_on is False, daemon.status)
    assert history()[-1][1] == 0.0
    plugins[which].wrong = None
    reset(daemon)


@pytest.mark.process
@pytest.mark.parametrize(
    ("which", "error"), [("force", SystemExit(3)), ("finger", RuntimeError("broken"))], ids=repr
)
def test_a_plugin_that_exits_is_told_as_any_failure_and_sensing_goes_on(
    daemon, history, plugins, which, error, monkeypatch
):
    monkeypatch.setattr(
        "haptic_driver.daemon.supervision.LOST_S", 0.3
    )  # then all is connected anew
    render(daemon, history)
    since = daemon.events(0)[-1].number
    plugins[which].wrong = error
    until(lambda: daemon.status().state is DaemonState.FAULT, daemon.status)
    name = type(error).__name__
    assert f"sensors: {name}" in daemon.status().fault
    assert any(event.kind == "flag" and name in event.message for event in daemon.events(since))
    until(lambda: daemon.status().output_on is False, daemon.status)
    assert history()[-1][1] == 0.0
    reset(daemon)
    until(
        lambda: (
            np.isfinite(daemon.shared.sensed.read().normal_force_n)
            and not daemon.supervisor.silent()
        )
    )
