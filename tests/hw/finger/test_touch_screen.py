from __future__ import annotations

import datetime
import errno
import math
import os
import struct
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from types import SimpleNamespace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptic_driver.rig.part import Wiring
from haptic_driver.rig.parts.finger_trackers import EvdevFingerConfig
from hw.errors import BadReply, DeviceDisconnected, DeviceError
from hw.finger.simulated_touch_screen import Panel
from hw.finger.touch_screen import (
    AreaCalibration,
    EvdevTouchScreen,
    RawTouch,
    Standing,
    TouchCalibration,
    TouchEvents,
    TouchReports,
    TouchScreen,
    open_touch_reports,
)
from hw.finger.tracker import FingerReading
from tests.clock import ManualClock
from tests.hw.testing.touch_screens import touch_screen

TODAY = datetime.date(2026, 1, 31)
# The inverse of the panel by hand: 20 counts per mm, origin at (50, 3000), y counted downwards.
CALIBRATION = TouchCalibration(
    ((5e-5, 0.0, -50 * 5e-5), (0.0, -5e-5, 3000 * 5e-5)), TODAY, placeholder=False
)
COUNT_M = 5e-5


class Bench:
    """A simulated screen and the tracker that reads it, on one clock."""

    def __init__(self, slots: int) -> None:
        self.clock = ManualClock(1000.0)
        self.screen = touch_screen(Panel(), slots=slots > 0, clock=self.clock)
        descriptor = self.screen.descriptor
        reports = TouchReports(
            descriptor,
            TouchEvents(self.screen.current_slot if slots else None),
            name="simulated touch screen",
            close=lambda: os.close(descriptor),
        )
        self.tracker = TouchScreen(reports, CALIBRATION, clock=self.clock)

    def put(self, x_m: float, y_m: float, *, finger: int = 0) -> FingerReading:
        self.clock.sleep(0.01)
        self.screen.put(x_m, y_m, finger=finger)
        return self.tracker.read()

    def lift(self, *, finger: int = 0) -> FingerReading:
        self.clock.sleep(0.01)
        self.screen.lift(finger=finger)
        return self.tracker.read()


@contextmanager
def plugged(slots: int) -> Iterator[Bench]:
    bench = Bench(slots)
    yield bench
    bench.tracker.close()
    bench.screen.unplug()


def placed(reading: FingerReading) -> tuple[float, float, bool]:
    """Where it is, to a nanometre, and whether it touches."""
    return round(reading.position_x_m, 9), round(reading.position_y_m, 9), reading.touching


@pytest.fixture(params=[10, 0], ids=["slots", "one finger"])
def bench(request):
    with plugged(request.param) as bench:
        yield bench


@pytest.fixture
def slotted():
    with plugged(10) as bench:
        yield bench


@pytest.fixture
def single():
    with plugged(0) as bench:
        yield bench


def test_before_the_first_touch_there_is_no_place(bench):
    reading = bench.tracker.read()
    assert reading.time_s == 1000.0
    assert math.isnan(reading.position_x_m)
    assert math.isnan(reading.position_y_m)
    assert reading.touching is False


def test_a_slide_is_followed_to_half_a_count(bench):
    for i in range(100):
        x_m, y_m = 0.01 + 0.0007 * i, 0.05 + 0.02 * math.sin(0.1 * i)
        reading = bench.put(x_m, y_m)
        assert reading.touching
        assert reading.time_s == pytest.approx(bench.clock(), abs=1e-6)
        assert reading.position_x_m == pytest.approx(x_m, abs=0.51 * COUNT_M)
        assert reading.position_y_m == pytest.approx(y_m, abs=0.51 * COUNT_M)
    reading = bench.lift()
    assert not reading.touching
    assert reading.position_x_m == pytest.approx(x_m, abs=0.51 * COUNT_M)


def test_a_touch_where_the_last_one_ended_has_a_place(bench):
    """The kernel does not repeat coordinates that did not change."""
    bench.put(0.02, 0.03)
    bench.lift()
    reading = bench.put(0.02, 0.03)
    assert (reading.touching, reading.position_x_m) == (True, pytest.approx(0.02))


def test_a_finger_at_rest_is_where_it_is_now(bench):
    bench.put(0.02, 0.03)
    touched_s = bench.clock()
    bench.clock.sleep(0.04)
    assert bench.tracker.read().time_s == pytest.approx(touched_s, abs=1e-6)
    bench.clock.sleep(0.02)
    assert bench.tracker.read()[:4] == (
        bench.clock(),
        pytest.approx(0.02),
        pytest.approx(0.03),
        True,
    )
    bench.clock.sleep(1.0)
    assert bench.tracker.read().time_s == bench.clock()


def test_an_opened_screen_is_asked_how_large_its_contacts_are(opened):
    sizes = {0x30: 12, 0x31: 8}

    def ioctl(_: int, request: int, answer: bytearray | bytes) -> int:
        if request == 0x8000450A | 12 << 16:
            code = struct.unpack_from("@i", answer)[0]
            struct.pack_into("@2i", answer, 4, 0, sizes.get(code, 0))
        return 0

    output, into = os.pipe()
    reports = opened(
        [0x2F, 0x35, 0x36, 0x39, *sizes],
        fd=output,
        absinfo=lambda code: SimpleNamespace(value=1, min=0, max=1),
        ioctl=ioctl,
    )
    values = [*LANDS, ((0, 0), 0)]
    os.write(into, b"".join(EVENT.pack(10, 0, *code, value) for code, value in values))
    assert reports.read().axes_raw2 == 96
    reports.close()
    os.close(into)


@given(
    st.lists(
        st.tuples(st.sampled_from(["put", "lift", "wait", "read"]), st.integers(0, 30)), max_size=60
    )
)
def test_times_never_go_back(script):
    told_s = 0.0
    with plugged(3) as bench:
        for action, number in script:
            bench.clock.sleep(0.001 * number)
            if action == "put":
                bench.screen.put(0.001 * number, 0.02, finger=number % 3)
            elif action == "lift":
                bench.screen.lift(finger=number % 3)
            reading = bench.tracker.read()
            assert told_s <= reading.time_s <= bench.clock() + 1e-6
            told_s = reading.time_s


def test_a_second_finger_changes_nothing_until_the_first_lifts(slotted):
    slotted.put(0.02, 0.03, finger=4)
    assert placed(slotted.put(0.09, 0.09, finger=1)) == (0.02, 0.03, True)
    assert slotted.put(0.03, 0.03, finger=4).position_x_m == pytest.approx(0.03)
    lifted = slotted.lift(finger=4)
    assert placed(lifted) == (0.03, 0.03, False)
    assert placed(slotted.put(0.091, 0.09, finger=1)) == (0.091, 0.09, True)
    assert slotted.lift(finger=1).touching is False


def test_all_that_touches_is_counted(slotted):
    """A second finger feels the same voltage, whoever is followed."""
    assert slotted.tracker.read().contacts == 0
    counted = [slotted.put(0.02 + 0.01 * k, 0.03, finger=k).contacts for k in range(3)]
    assert counted == [1, 2, 3]
    assert [slotted.lift(finger=k).contacts for k in range(3)] == [2, 1, 0]


def test_a_screen_for_one_finger_counts_none(single):
    assert single.put(0.02, 0.03).contacts is None


@pytest.mark.parametrize(
    ("axis", "value", "contacts", "palm"),
    [(0x37, 0, 2, False), (0x37, 2, 2, True), (0x37, 1, 1, False), (0x3B, 5, 1, False)],
    ids=["finger", "palm", "pen", "hovers"],
)
def test_a_palm_counts_and_a_pen_does_not(axis, value, contacts, palm):
    events = TouchEvents(lambda: 0)
    first = [(10, 0, 3, 0x39, 1), (10, 0, 3, 0x35, 100), (10, 0, 3, 0x36, 200)]
    second = [(10, 0, 3, 0x2F, 1), (10, 0, 3, 0x39, 2), (10, 0, 3, axis, value)]
    for event in (*first, *second):
        events.feed(EVENT.pack(*event))
    assert events.contacts == 0  # not before the report has ended
    events.feed(EVENT.pack(10, 0, 0, 0, 0))
    assert (events.contacts, events.palm) == (contacts, palm)


def test_dropped_events_end_a_touch_that_may_have_ended(bench):
    bench.put(0.02, 0.03)
    bench.screen.lose_events()
    bench.lift()
    bench.screen.find_events()
    assert placed(bench.tracker.read()) == (0.02, 0.03, False)
    bench.clock.sleep(1.0)
    assert bench.tracker.read().touching is False


def test_after_dropped_events_a_finger_is_found_again_where_it_is(slotted):
    slotted.put(0.02, 0.03)
    slotted.screen.lose_events()
    slotted.put(0.05, 0.06)
    slotted.screen.find_events()
    assert slotted.tracker.read().touching is False
    assert slotted.put(0.07, 0.06).touching is False  # y is not known yet
    assert placed(slotted.put(0.07, 0.08)) == (0.07, 0.08, True)


def test_after_dropped_events_one_finger_counts_from_its_next_touch(single):
    single.put(0.02, 0.03)
    single.screen.lose_events()
    single.put(0.05, 0.06)
    single.screen.find_events()
    assert single.put(0.07, 0.08).touching is False
    single.lift()
    assert placed(single.put(0.075, 0.085)) == (0.075, 0.085, True)


def test_an_unplugged_screen_is_an_error(bench):
    bench.put(0.02, 0.03)
    bench.screen.unplug()
    for _ in range(2):
        with pytest.raises(DeviceDisconnected, match="simulated touch screen is gone"):
            bench.tracker.read()


def test_a_kernel_error_is_an_unplugged_screen(bench, monkeypatch):
    def gone(descriptor: int, count: int) -> bytes:
        raise OSError(errno.ENODEV, "No such device")

    monkeypatch.setattr(os, "read", gone)
    with pytest.raises(DeviceDisconnected, match="No such device"):
        bench.tracker.read()


def test_a_closed_tracker_says_so(bench):
    bench.tracker.close()
    bench.tracker.close()
    with pytest.raises(DeviceDisconnected, match="closed"):
        bench.tracker.read()


def test_a_long_backlog_is_read_in_one_go(bench):
    for i in range(300):
        bench.clock.sleep(0.01)
        bench.screen.put(0.0001 * i, 0.0001 * i)
    assert placed(bench.tracker.read()) == (0.0299, 0.0299, True)


def test_a_backlog_that_ran_over_ends_the_touch(bench):
    for i in range(2000):
        bench.clock.sleep(0.01)
        bench.screen.put(0.0001 * i, 0.0001 * i)
    bench.tracker.read()
    assert bench.put(0.01, 0.01).touching is False
    bench.put(0.02, 0.02)
    bench.lift()
    assert placed(bench.put(0.03, 0.03)) == (0.03, 0.03, True)


EVENT = struct.Struct("@llHHi")
# as by evtest on a screen with slots: one touch at (100, 200), moved to (110, 200), lifted
RECORDING = [
    (10, 0, 3, 0x39, 45),
    (10, 0, 3, 0x35, 100),
    (10, 0, 3, 0x36, 200),
    (10, 0, 1, 0x14A, 1),
    (10, 0, 0, 0, 0),
    (10, 8000, 3, 0x35, 110),
    (10, 8000, 3, 0x00, 110),
    (10, 8000, 0, 0, 0),
    (10, 16000, 3, 0x39, -1),
    (10, 16000, 1, 0x14A, 0),
    (10, 16000, 0, 0, 0),
]


@given(st.lists(st.integers(1, 60), max_size=40))
def test_events_may_be_cut_anywhere(cuts):
    stream = b"".join(EVENT.pack(*event) for event in RECORDING)
    events, seen = TouchEvents(lambda: 0), []
    for cut in [*cuts, len(stream)]:
        seen.append(events.feed(stream[:cut]))
        stream = stream[cut:]
    told = [report[:4] for report in seen if report is not None]
    assert told[-1] == (10.016, 110, 200, False)
    assert set(told) <= {
        (10.0, 100, 200, True),
        (10.008, 110, 200, True),
        (10.016, 110, 200, False),
    }


SLOT, CONTACT, PLACE_X, PLACE_Y = (3, 0x2F), (3, 0x39), (3, 0x35), (3, 0x36)
TOOL, DISTANCE, ONE_DISTANCE = (3, 0x37), (3, 0x3B), (3, 0x19)
MAJOR, MINOR, PRESSURE, ONE_PRESSURE = (3, 0x30), (3, 0x31), (3, 0x3A), (3, 0x18)
TOUCH, PEN, ONE_X, ONE_Y = (1, 0x14A), (1, 0x140), (3, 0x00), (3, 0x01)
LANDS = [(CONTACT, 45), (PLACE_X, 100), (PLACE_Y, 200), (TOUCH, 1)]
LANDS_ON_ONE = [(ONE_X, 100), (ONE_Y, 200), (TOUCH, 1)]


def told(events: TouchEvents, *values: tuple[tuple[int, int], int]) -> bool | None:
    """Whether a finger touches after one report of these; None where no place is known."""
    packed = [EVENT.pack(10, 0, *code, value) for code, value in values]
    report = events.feed(b"".join([*packed, EVENT.pack(10, 0, 0, 0, 0)]))
    return None if report is None else report.touching


@pytest.mark.parametrize(
    ("axes", "area_m2"),
    [
        ([(MAJOR, 12), (MINOR, 8)], 96e-6),
        ([(MAJOR, 12)], 144e-6),  # round, as the kernel's documentation has it
        ([(MINOR, 8)], math.nan),
        ([], math.nan),
    ],
)
def test_the_axes_of_a_contact_tell_its_area(axes, area_m2):
    events = TouchEvents(lambda: 0)
    packed = [EVENT.pack(10, 0, *code, value) for code, value in [*LANDS, *axes]]
    report = events.feed(b"".join([*packed, EVENT.pack(10, 0, 0, 0, 0)]))
    found = AreaCalibration(1e-6, 0.2).area_m2(report)
    assert found == pytest.approx((area_m2, 0.2 * area_m2), nan_ok=True)


def test_a_rigs_file_says_how_its_screen_tells_an_area():
    area = {"m2_per_raw2": 7.9e-7, "log_std": 0.2, "measured_at": TODAY}
    own = {"device": "/dev/input/event0", "matrix_m": [[1e-5, 0, 0], [0, 1e-5, 0]]}
    section = EvdevFingerConfig(
        kind="evdev", measured_at=TODAY, placeholder=False, area=area, **own
    )
    assert section.make(Wiring()).device.area == AreaCalibration(7.9e-7, 0.2)


def test_the_area_that_the_kernel_has_already_counts():
    events = TouchEvents(lambda: 0, lambda: Standing(major_raw=[10], minor_raw=[7]))
    packed = [EVENT.pack(10, 0, *code, value) for code, value in LANDS]
    report = events.feed(b"".join([*packed, EVENT.pack(10, 0, 0, 0, 0)]))
    assert report.axes_raw2 == 70


def test_a_finger_that_hovers_does_not_touch():
    events = TouchEvents(lambda: 0)
    assert told(events, (DISTANCE, 1), *LANDS[:3], (TOUCH, 0)) is False
    assert told(events, (PLACE_X, 120)) is False
    assert told(events, (DISTANCE, 0), (TOUCH, 1)) is True
    assert told(events, (DISTANCE, 1)) is False  # of a screen that keeps BTN_TOUCH
    one = TouchEvents(None)
    assert told(one, *LANDS_ON_ONE) is True
    assert told(one, (ONE_DISTANCE, 1)) is False
    assert told(one, (ONE_DISTANCE, 0)) is True


@given(st.lists(st.tuples(st.sampled_from([PRESSURE, MAJOR, DISTANCE]), st.integers(0, 3))))
def test_a_finger_touches_while_every_axis_that_can_tell_says_so(script):
    events, now, weighs = TouchEvents(lambda: 0), {DISTANCE: 0}, set()
    assert told(events, *LANDS) is True
    for x, (axis, value) in enumerate(script, start=101):
        now[axis] = value
        weighs |= {axis} if value and axis != DISTANCE else set()
        wanted = not now[DISTANCE] and all(now[each] for each in weighs)
        assert told(events, (PLACE_X, x), (axis, value)) is wanted


def test_pressure_lifts_the_finger_of_a_screen_for_one():
    one = TouchEvents(None)
    assert told(one, *LANDS_ON_ONE, (ONE_PRESSURE, 30)) is True
    assert told(one, (ONE_PRESSURE, 0)) is False
    assert told(one, (ONE_PRESSURE, 9)) is True


def test_after_lost_events_the_pressure_that_the_kernel_has_counts():
    standing = Standing(pressure_raw=[30], major_raw=[5])
    events = TouchEvents(lambda: 0, lambda: standing)
    assert told(events, *LANDS) is True
    standing = Standing(pressure_raw=[0], major_raw=[0])
    told(events, ((0, 3), 0))
    assert told(events, (PLACE_X, 140), (PLACE_Y, 150)) is False
    assert told(events, (PRESSURE, 12), (MAJOR, 2)) is True


@pytest.mark.parametrize("tool", [1, 2, 10], ids=["pen", "palm", "dial"])
def test_what_is_no_finger_does_not_touch(tool):
    events = TouchEvents(lambda: 0)
    assert told(events, *LANDS) is True
    assert told(events, (TOOL, tool)) is False
    assert told(events, (TOOL, 0)) is True


def test_a_pen_on_a_screen_for_one_does_not_touch():
    one = TouchEvents(None)
    assert told(one, (PEN, 1), *LANDS_ON_ONE) is False
    assert told(one, (TOUCH, 0), (PEN, 0)) is False
    assert told(one, (TOUCH, 1)) is True


def test_the_key_lifts_every_finger_whose_slot_has_not_said_so():
    events = TouchEvents(lambda: 0)
    assert told(events, *LANDS, (SLOT, 1), *LANDS[:3]) is True
    assert told(events, (TOUCH, 0)) is False
    assert told(events, (TOUCH, 1)) is False  # which one, nobody says
    assert told(events, (SLOT, 0), (PLACE_X, 101)) is True
    assert told(events, (TOUCH, 0)) is False
    assert told(events, (CONTACT, 46), (TOUCH, 1)) is True


def test_beside_a_palm_the_finger_is_followed():
    events = TouchEvents(lambda: 0)
    assert told(events, (TOOL, 2), *LANDS) is False
    packed = [(SLOT, 3), (CONTACT, 46), (PLACE_X, 500), (PLACE_Y, 600), ((0, 0), 0)]
    report = events.feed(b"".join(EVENT.pack(10, 0, *code, value) for code, value in packed))
    assert report[:4] == (10.0, 500, 600, True)


@pytest.mark.parametrize("standing", [Standing([0, 3]), Standing([], [0, 2])])
def test_what_the_kernel_does_not_repeat_is_asked_for(standing):
    """At the beginning, and after events were dropped: slot 1 hovers, or is a palm."""
    events = TouchEvents(lambda: 1, lambda: standing)
    assert told(events, *LANDS) is False
    assert told(events, (SLOT, 0), *LANDS) is True
    events.feed(EVENT.pack(10, 0, 0, 3, 0))
    told(events)
    assert not told(events, (SLOT, 1), (PLACE_X, 7), (PLACE_Y, 8))
    assert told(events, (SLOT, 0), (PLACE_X, 7), (PLACE_Y, 8)) is True


@pytest.fixture
def opened(monkeypatch):
    """Open a device of these axes and keys, as python-evdev gives it; what it closes."""

    def run(axes: list[int], keys: Sequence[int] = (0x14A,), **more: Any) -> TouchReports:
        told = {"fd": -1, "name": "pad", "capabilities": lambda **_: {3: axes, 1: list(keys)}}
        device = SimpleNamespace(**told, close=lambda: closed.append(device.fd))
        vars(device).update(more)
        evdev = SimpleNamespace(InputDevice=lambda path, readonly: device)
        monkeypatch.setitem(sys.modules, "evdev", evdev)
        monkeypatch.setattr("fcntl.ioctl", more.get("ioctl", lambda *_: 0))
        return open_touch_reports("/dev/input/event0")

    closed: list[int] = []
    run.closed = closed  # type: ignore[attr-defined]
    yield run
    for descriptor in filter(lambda each: each >= 0, closed):
        os.close(descriptor)


@pytest.mark.parametrize("keys", [[], [0x14A]], ids=["bare", "with a key"])
def test_a_screen_without_slots_for_several_fingers_is_refused_by_name(opened, keys):
    """Protocol A, as its drivers declare it: positions, no slots, often ABS_X and ABS_Y as well."""
    with pytest.raises(BadReply, match=r"'pad'.*protocol A") as failure:
        opened([0x00, 0x01, 0x30, 0x35, 0x36], keys)
    assert "ABS_MT_SLOT" in failure.value.hint
    assert "mtdev" in failure.value.hint


@pytest.mark.parametrize("slots", [True, False])
def test_an_opened_screen_is_asked_what_hovers(opened, slots):
    """EVIOCGMTSLOTS of linux/input.h: code, then a value per slot, in an array of its size."""
    asked = []

    def ioctl(_: int, request: int, answer: bytearray | bytes) -> int:
        if request == 0x8000450A | 12 << 16:
            asked.append(struct.unpack_from("@i", answer)[0])
            struct.pack_into("@2i", answer, 4, 0, 5 if asked[-1] == 0x3B else 0)
        return 0

    output, into = os.pipe()
    reports = opened(
        [0x2F, 0x35, 0x36, 0x39, 0x37, 0x3B] if slots else [0, 1, 0x19],
        fd=output,
        absinfo=lambda code: SimpleNamespace(value=5 if code == 0x19 else 1, min=0, max=1),
        ioctl=ioctl,
    )
    values = [*(LANDS if slots else LANDS_ON_ONE), ((0, 0), 0)]
    os.write(into, b"".join(EVENT.pack(10, 0, *code, value) for code, value in values))
    assert reports.read()[:4] == (10.0, 100, 200, False)
    assert asked == ([0x3B, 0x37] if slots else [])
    reports.close()
    os.close(into)


@given(
    st.lists(
        st.tuples(
            st.integers(0, 4),
            st.integers(0, 0x40) | st.just(0x14A),
            st.integers(-(2**31), 2**31 - 1),
        )
    )
)
def test_senseless_events_break_nothing(events):
    stream = b"".join(EVENT.pack(1, 2, *event) for event in events)
    for slots in (None, lambda: 0):
        touch = TouchEvents(slots)
        touch.feed(stream)
        touch.feed(EVENT.pack(1, 2, 0, 0, 0))


def test_the_codes_are_those_of_evdev():
    evdev = pytest.importorskip("evdev", reason="evdev is not installed")
    names = "SYN_DROPPED BTN_TOUCH ABS_X ABS_Y ABS_MT_SLOT ABS_MT_POSITION_X ABS_MT_POSITION_Y"
    names += " ABS_MT_TRACKING_ID ABS_MT_TOOL_TYPE ABS_MT_DISTANCE ABS_DISTANCE ABS_MT_TOUCH_MAJOR"
    names += " ABS_MT_PRESSURE ABS_PRESSURE BTN_TOOL_PEN BTN_TOOL_AIRBRUSH EV_KEY EV_ABS"
    assert [getattr(evdev.ecodes, name) for name in names.split()] == [
        *(3, 0x14A, 0, 1, 0x2F, 0x35, 0x36, 0x39, 0x37, 0x3B, 0x19, 0x30, 0x3A, 0x18),
        *(0x140, 0x144, 1, 3),
    ]


def test_evdev_missing_names_the_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, "evdev", None)
    with pytest.raises(DeviceError) as failure:
        EvdevTouchScreen("/dev/input/event0", CALIBRATION).open()
    assert "haptic-driver[touch]" in failure.value.hint


def test_nothing_is_opened_before_open():
    """Once a rig's touch screen was opened where the rig was only put together."""
    screen = EvdevTouchScreen("/dev/input/no-such-event", CALIBRATION)
    with pytest.raises(DeviceDisconnected, match="no-such-event is not open"):
        screen.read()
    screen.close()


@pytest.mark.parametrize("path", ["/dev/input/no-such-event", "/dev/null"])
def test_what_is_no_event_device_is_refused(path):
    pytest.importorskip("evdev", reason="evdev is not installed")
    with pytest.raises(DeviceDisconnected, match=path):
        EvdevTouchScreen(path, CALIBRATION).open()


@pytest.mark.parametrize("fails_at", ["ioctl", "capabilities", "absinfo", "no touch screen"])
def test_a_device_that_cannot_be_taken_is_let_go_and_said_to_be_gone(opened, fails_at):
    def unplugged(*_: object, **__: object) -> None:
        raise OSError(19, "No such device")

    axes = [] if fails_at == "no touch screen" else [0x2F, 0x35, 0x36, 0x39]
    more = {"absinfo": lambda code: None} | {fails_at: unplugged}
    gone = BadReply if fails_at == "no touch screen" else DeviceDisconnected
    with pytest.raises(gone, match="/dev/input/event0"):
        opened(axes, [], **more)
    assert opened.closed == [-1]


@pytest.mark.skipif(not os.access("/dev/uinput", os.W_OK), reason="needs a writable /dev/uinput")
def test_a_real_event_device():
    evdev = pytest.importorskip("evdev", reason="evdev is not installed")
    codes = evdev.ecodes
    axis = evdev.AbsInfo(value=0, min=0, max=4095, fuzz=0, flat=0, resolution=20)
    with evdev.UInput(
        {codes.EV_ABS: [(codes.ABS_X, axis), (codes.ABS_Y, axis)], codes.EV_KEY: [codes.BTN_TOUCH]}
    ) as pad:
        time.sleep(0.5)  # for the device node to appear
        tracker = EvdevTouchScreen(pad.device.path, CALIBRATION)
        tracker.open()
        before_s = time.monotonic()
        for code, value in ((codes.ABS_X, 150), (codes.ABS_Y, 2900)):
            pad.write(codes.EV_ABS, code, value)
        pad.write(codes.EV_KEY, codes.BTN_TOUCH, 1)
        pad.syn()
        reading = tracker.read()
        assert reading[1:4] == (pytest.approx(0.005), pytest.approx(0.005), True)
        assert before_s - 1e-3 <= reading.time_s <= time.monotonic()
        tracker.close()


def test_an_opened_screen_tells_whether_it_says_how_large_a_contact_is(opened):
    screen = touch_screen(Panel(), slots=True, clock=ManualClock(1000.0))
    zero = SimpleNamespace(value=0, min=0, max=9)
    reports = opened(
        [0x2F, 0x30, 0x35, 0x36, 0x39], fd=screen.descriptor, absinfo=lambda code: zero
    )
    assert reports.tells_area
    reports.close()


@pytest.mark.parametrize(("slots", "axes"), [(True, (0x35, 0x36)), (False, (0x00, 0x01))])
def test_an_opened_screen_tells_counts_and_the_range_of_its_axes(opened, slots, axes):
    clock = ManualClock(1000.0)
    screen = touch_screen(Panel(), slots=slots, clock=clock)
    ranges = dict(zip(axes, ((50, 4050), (0, 3000)), strict=True))

    def absinfo(code: int) -> SimpleNamespace:
        low, high = ranges.get(code, (0, 9))
        return SimpleNamespace(value=screen.current_slot(), min=low, max=high)

    reports = opened(
        [0x2F, 0x35, 0x36, 0x39] if slots else [0, 1], fd=screen.descriptor, absinfo=absinfo
    )
    assert reports.span_raw == (4000, 3000)
    assert reports.tells_area is False
    assert reports.read()[:4] == (-math.inf, 0, 0, False)
    screen.put(0.010, 0.050)
    assert reports.read() == RawTouch(clock(), 250, 2000, True)
    reports.close()
    screen.unplug()
    with pytest.raises(DeviceDisconnected, match="is closed"):
        reports.read()
