"""One record with every reading, kept in a device's place, whatever the device's make."""

import math
from types import SimpleNamespace

import pytest

from hw.errors import DeviceTimeout
from hw.finger.tracker import FingerReading
from hw.force.sensor import ForceReading, KeepsReadings
from hw.health import FORCE, REPEATS_S, STAGE, TRACKER, with_health
from tests.clock import ManualClock

TOOK_S = 0.003


class Sensor:
    """A sensor of somebody's own, which knows nothing of health; a reading takes `TOOK_S`."""

    def __init__(self, clock):
        self.clock, self.says, self.fails = clock, ForceReading(0.0, 0.5, 0.3, False), None
        self.bias = (0.25, -0.5)

    def read(self):
        self.clock.sleep(TOOK_S)
        if self.fails is not None:
            raise self.fails
        return self.says

    def take_readings(self):
        return [self.says]

    def take_bias(self):
        return self.bias


class Bench:
    """The sensor, with its health, on a clock that is stepped."""

    def __init__(self):
        self.clock = ManualClock(100.0)
        self.own = Sensor(self.clock)
        self.sensor = with_health(self.own, "force_sensor", FORCE, self.clock)

    def reads(self, load_n, after_s=0.01, time_s=None, saturated=False):
        """The health after one more reading, stamped as it is taken unless its time is said."""
        self.clock.now_s += after_s
        stamp_s = self.clock.now_s if time_s is None else time_s
        self.own.says = ForceReading(stamp_s, load_n, 0.3, saturated)
        assert self.sensor.read() == self.own.says
        return self.sensor.health


@pytest.fixture
def bench():
    return Bench()


def test_nobody_asked_is_nothing_known(bench):
    health = bench.sensor.health
    assert (health.name, health.asked, health.wrong) == ("force_sensor", 0, "")
    assert health.age_s(bench.clock()) == math.inf


def test_a_reading_tells_when_it_was_taken_and_heard_and_how_long_it_took(bench):
    health = bench.reads(0.5, time_s=99.5)
    assert health.taken_s == 99.5
    assert health.took_s == pytest.approx(TOOK_S)
    bench.clock.now_s += 2.0
    assert health.age_s(bench.clock()) == pytest.approx(2.0)


def test_one_that_comes_again_with_its_stamp_is_not_heard_again(bench):
    first = bench.reads(0.5, time_s=99.5)
    again = bench.reads(0.5, time_s=99.5)
    assert (again.asked, again.heard_s) == (2, first.heard_s)


@pytest.mark.parametrize("failure", [DeviceTimeout("no answer"), ValueError("no answer")])
def test_a_question_without_an_answer_is_missed_and_the_next_answer_mends_it(bench, failure):
    before = bench.reads(0.5)
    bench.own.fails = failure
    with pytest.raises(type(failure)):
        bench.sensor.read()
    health = bench.sensor.health
    assert (health.asked, health.missed, health.wrong) == (2, 1, "no answer")
    assert health.heard_s == before.heard_s
    bench.own.fails = None
    mended = bench.reads(0.51)
    assert (mended.asked, mended.missed, mended.wrong) == (3, 1, "")


def test_what_noise_should_move_and_rests_is_frozen_however_new_its_stamps(bench):
    while (health := bench.reads(0.5)).same_s < REPEATS_S:
        assert health.wrong == ""
    assert "frozen" in health.wrong
    assert bench.reads(0.5001).wrong == ""


def test_a_number_that_comes_again_after_nobody_asked_is_no_frozen_sensor(bench):
    bench.reads(0.5)
    assert bench.reads(0.5, after_s=60.0).same_s == 0.0


def test_saturation_and_the_mending_of_it(bench):
    assert bench.reads(9.0, saturated=True).wrong == "saturated"
    assert bench.reads(0.5).wrong == ""


def test_the_zero_is_kept_with_its_time_and_by_the_next_connection(bench):
    bench.sensor.keeper.take_zero(bench.own.take_bias)
    taken = bench.sensor.health
    assert (taken.zero, taken.zero_s) == ((0.25, -0.5), 100.0)
    bench.clock.now_s += 60.0
    after = Bench()
    after.sensor.keeper.keep_zero(lambda: None, taken)
    assert (after.sensor.health.zero, after.sensor.health.zero_s) == ((0.25, -0.5), 100.0)


def test_a_zero_of_which_nothing_is_said_has_its_time_alone(bench):
    bench.sensor.keeper.take_zero(lambda: None)
    assert (bench.sensor.health.zero, bench.sensor.health.zero_s) == ((), 100.0)


def test_a_stage_shows_where_it_was_sent_and_where_it_is():
    moves = []
    status = SimpleNamespace(time_s=1.0, position_m=0.0101)
    stage = SimpleNamespace(move_to=moves.append, read_status=lambda: status)
    heard = with_health(stage, "stage", STAGE, ManualClock())
    heard.move_to(0.010)
    heard.read_status()
    assert moves == [0.010]
    assert (heard.health.ordered, heard.health.got) == (0.010, 0.0101)


def test_in_all_else_it_is_the_device(bench):
    assert isinstance(bench.sensor, Sensor)
    assert isinstance(bench.sensor, KeepsReadings)
    assert bench.sensor.take_readings() == [bench.own.says]
    with pytest.raises(AttributeError, match="nowhere"):
        bench.sensor.nowhere()


def test_a_tracker_is_told_by_the_reports_of_a_finger_that_moves():
    """Polled every 2 ms: a report every 8 or 12 ms, a rest of 0.5 s that is none, then the same."""
    clock, told = ManualClock(100.0), SimpleNamespace(says=None)
    told.read = lambda: told.says
    tracker = with_health(told, "finger_tracker", TRACKER, clock)
    due_s, stamps_s = 100.0, []
    for k in range(400):
        due_s += 0.5 if k == 200 else (0.008, 0.012)[k % 2]
        stamps_s.append(due_s)
    assert math.isnan(tracker.health.every_s)
    for k, stamp_s in enumerate(stamps_s):
        told.says = FingerReading(stamp_s, 1e-4 * k, 0.02, True)
        while clock.now_s < stamp_s + 0.008:
            clock.now_s += 0.002
            tracker.read()
    # alternating by 2 ms to either side of 10; the newest hundred weigh most
    assert tracker.health.every_s == pytest.approx(0.010, abs=1e-4)
    assert tracker.health.jitter_s == pytest.approx(0.002, rel=0.05)


def test_a_tracker_that_knows_no_place_tells_no_reports():
    clock, told = ManualClock(100.0), SimpleNamespace()
    told.read = lambda: FingerReading(clock.now_s, float("nan"), float("nan"), False)
    tracker = with_health(told, "finger_tracker", TRACKER, clock)
    for _ in range(10):
        clock.now_s += 0.002
        tracker.read()
    assert math.isnan(tracker.health.every_s)
