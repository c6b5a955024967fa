"""Simulated touch screens that tell fingers apart by slots, lose events, and can be unplugged."""

from __future__ import annotations

import os
from collections.abc import Callable
from contextlib import suppress

from hw.finger.simulated_touch_screen import (
    ABS_X,
    ABS_Y,
    BTN_TOUCH,
    SYN_DROPPED,
    SYN_REPORT,
    Event,
    Panel,
    SimulatedTouchScreen,
)

_ABS_MT_SLOT, _ABS_MT_TRACKING_ID = (0x03, 0x2F), (0x03, 0x39)
_ABS_MT_POSITION_X, _ABS_MT_POSITION_Y = (0x03, 0x35), (0x03, 0x36)


class FaultyTouchScreen(SimulatedTouchScreen):
    """For one finger; `lose_events` has the effect of a buffer that runs over."""

    _lost = False

    def put(self, x_m: float, y_m: float, *, finger: int = 0) -> None:
        super().put(x_m, y_m)

    def lift(self, *, finger: int = 0) -> None:
        super().lift()

    def current_slot(self) -> int:
        """The slot that the next event without a slot belongs to (EVIOCGABS of ABS_MT_SLOT)."""
        return 0

    def lose_events(self) -> None:
        """Until `find_events`, what happens is not told; the reader learns that something is
        missing.
        """
        self._lost = True

    def find_events(self) -> None:
        """Say that events were dropped, as the kernel does, with the end of the report that was
        under way.
        """
        self._lost = False
        self._write([(SYN_DROPPED, 0), (ABS_X, 1), (SYN_REPORT, 0)])

    def unplug(self) -> None:
        """End of file at the reader's end."""
        with suppress(OSError):
            os.close(self.output)
        self.output = -1

    def _write(self, events: list[Event]) -> None:
        if not self._lost and self.output >= 0:
            super()._write(events)


class SlottedTouchScreen(FaultyTouchScreen):
    """Any number of fingers, one per slot (protocol B)."""

    def __init__(self, panel: Panel, *, clock: Callable[[], float]) -> None:
        super().__init__(panel, clock=clock)
        self._slots: dict[int, dict[tuple[int, int], int]] = {}
        self._contacts = 0
        self._slot = 0
        self._finger = 0  # that is put down or moved

    def current_slot(self) -> int:
        return self._slot

    def put(self, x_m: float, y_m: float, *, finger: int = 0) -> None:
        self._finger = finger
        super().put(x_m, y_m)

    def lift(self, *, finger: int = 0) -> None:
        if self._is_down(finger):
            others = any(self._is_down(other) for other in self._slots if other != finger)
            self._report_slot(finger, [(_ABS_MT_TRACKING_ID, -1)], [(BTN_TOUCH, int(others))])

    def repeat(self) -> None:
        events: list[Event] = []
        for slot, sent in sorted(self._slots.items()):
            self._slot = slot
            events += [(_ABS_MT_SLOT, slot), *sent.items()]
        if events:
            self._write([*events, *self._sent.items(), (SYN_REPORT, 0)])

    def _touch(self, x_raw: int, y_raw: int) -> None:
        places = [(_ABS_MT_POSITION_X, x_raw), (_ABS_MT_POSITION_Y, y_raw)]
        if not self._is_down(self._finger):
            self._contacts += 1
            places.insert(0, (_ABS_MT_TRACKING_ID, self._contacts))
        self._report_slot(self._finger, places, [(BTN_TOUCH, 1), (ABS_X, x_raw), (ABS_Y, y_raw)])

    def _is_down(self, finger: int) -> bool:
        return self._slots.get(finger, {}).get(_ABS_MT_TRACKING_ID, -1) >= 0

    def _report_slot(self, finger: int, slotted: list[Event], single: list[Event]) -> None:
        sent = self._slots.setdefault(finger, {})
        changed = [(code, value) for code, value in slotted if sent.get(code) != value]
        sent.update(changed)
        if changed and self._slot != finger:
            self._slot = finger
            changed.insert(0, (_ABS_MT_SLOT, finger))
        also = [(code, value) for code, value in single if self._sent.get(code) != value]
        self._sent.update(also)
        if changed or also:
            self._write([*changed, *also, (SYN_REPORT, 0)])


def touch_screen(panel: Panel, *, slots: bool, clock: Callable[[], float]) -> FaultyTouchScreen:
    """One with slots, or for one finger only."""
    return (SlottedTouchScreen if slots else FaultyTouchScreen)(panel, clock=clock)
