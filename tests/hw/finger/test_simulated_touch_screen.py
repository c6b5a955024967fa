"""What the simulated touch screen writes, read by evdev's own parser."""

from __future__ import annotations

import os

import pytest

from hw.finger.simulated_touch_screen import Panel
from hw.finger.touch_screen import TouchEvents
from tests.hw.testing.touch_screens import SlottedTouchScreen, touch_screen

evdev = pytest.importorskip("evdev", reason="evdev is not installed")


class Reader:
    def __init__(self, slots: int) -> None:
        self.now_s = 12.5
        self.screen = touch_screen(Panel(), slots=slots > 0, clock=lambda: self.now_s)
        os.set_blocking(self.screen.descriptor, False)

    def events(self) -> list[tuple[str, int]]:
        """Names and values; a name is the first that evdev knows."""
        read = evdev._input.device_read_many(self.screen.descriptor)
        assert {seconds + 1e-6 * micros for seconds, micros, *_ in read} <= {self.now_s}
        return [(self._name(kind, code), value) for _, _, kind, code, value in read]

    @staticmethod
    def _name(kind: int, code: int) -> str:
        name = evdev.ecodes.bytype[kind][code]
        return name if isinstance(name, str) else name[0]


@pytest.fixture
def reader(request):
    reader = Reader(request.param)
    yield reader
    reader.screen.unplug()
    os.close(reader.screen.descriptor)


@pytest.mark.parametrize("reader", [5], indirect=True)
def test_a_screen_with_slots(reader):
    reader.screen.put(0.010, 0.050)
    assert reader.events() == [
        ("ABS_MT_TRACKING_ID", 1),
        ("ABS_MT_POSITION_X", 250),  # 50 + 20 per mm
        ("ABS_MT_POSITION_Y", 2000),  # 3000 - 20 per mm
        ("BTN_TOUCH", 1),
        ("ABS_X", 250),
        ("ABS_Y", 2000),
        ("SYN_REPORT", 0),
    ]
    reader.now_s += 0.25
    reader.screen.put(0.020, 0.050)
    assert reader.events() == [("ABS_MT_POSITION_X", 450), ("ABS_X", 450), ("SYN_REPORT", 0)]
    reader.now_s += 0.25
    reader.screen.put(0.020, 0.060, finger=2)
    assert reader.events()[:2] == [("ABS_MT_SLOT", 2), ("ABS_MT_TRACKING_ID", 2)]
    assert reader.screen.current_slot() == 2
    reader.screen.lift(finger=0)
    assert reader.events() == [("ABS_MT_SLOT", 0), ("ABS_MT_TRACKING_ID", -1), ("SYN_REPORT", 0)]
    reader.screen.lift(finger=2)
    assert ("BTN_TOUCH", 0) in reader.events()


@pytest.mark.parametrize("reader", [0], indirect=True)
def test_a_screen_for_one_finger(reader):
    reader.screen.put(0.0, 0.0)
    assert reader.events() == [("BTN_TOUCH", 1), ("ABS_X", 50), ("ABS_Y", 3000), ("SYN_REPORT", 0)]
    reader.screen.lift()
    assert reader.events() == [("BTN_TOUCH", 0), ("SYN_REPORT", 0)]


@pytest.mark.parametrize("reader", [0, 5], indirect=True)
def test_reports_keep_to_the_rate_and_say_only_what_changed(reader):
    reader.screen.put(0.0, 0.0)
    assert reader.events()
    reader.now_s += 0.007  # 125 Hz: the next is due after 8 ms
    reader.screen.put(0.010, 0.0)
    with pytest.raises(BlockingIOError):
        reader.events()
    reader.now_s += 0.002
    reader.screen.put(0.0, 0.0)
    with pytest.raises(BlockingIOError):
        reader.events()


@pytest.mark.parametrize("reader", [0, 5], indirect=True)
def test_lost_events_are_announced(reader):
    reader.screen.put(0.0, 0.0)
    reader.events()
    reader.screen.lose_events()
    reader.screen.lift()
    with pytest.raises(BlockingIOError):
        reader.events()
    reader.screen.find_events()
    names = [name for name, _ in reader.events()]
    assert (names[0], names[-1]) == ("SYN_DROPPED", "SYN_REPORT")


@pytest.mark.parametrize("reader", [0, 5], indirect=True)
def test_a_reader_that_comes_late_learns_where_the_finger_is(reader):
    """Bug: only changes are told, so a tracker that missed the touch never knew the axis along
    which nothing moved.
    """
    reader.screen.put(0.010, 0.050)
    os.read(reader.screen.descriptor, 1 << 16)  # nobody there yet
    late = TouchEvents(
        reader.screen.current_slot if isinstance(reader.screen, SlottedTouchScreen) else None
    )
    reader.screen.repeat()
    reader.now_s += 0.25
    reader.screen.put(0.020, 0.050)
    touch = late.feed(os.read(reader.screen.descriptor, 1 << 16))
    assert touch is not None
    assert (touch.x_raw, touch.y_raw, touch.touching) == (450, 2000, True)
