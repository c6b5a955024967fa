"""A simulated touch screen: writes the kernel's `struct input_event` to a file, as an event device gives them."""

from __future__ import annotations

import os
import struct
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass

# 64-bit Linux: seconds, microseconds, type, code, value. The simulator's own table of codes.
_INPUT_EVENT = struct.Struct("<qqHHi")
_SYN_REPORT, _SYN_DROPPED = (0x00, 0x00), (0x00, 0x03)
_BTN_TOUCH = (0x01, 0x14A)
_ABS_X, _ABS_Y = (0x03, 0x00), (0x03, 0x01)
_ABS_MT_SLOT, _ABS_MT_TRACKING_ID = (0x03, 0x2F), (0x03, 0x39)
_ABS_MT_POSITION_X, _ABS_MT_POSITION_Y = (0x03, 0x35), (0x03, 0x36)


@dataclass(frozen=True)
class Panel:
    """The panel's geometry: counts per metre along each axis, counts at the origin; a mirrored axis counts down."""

    x_counts_per_m: float = 20e3
    y_counts_per_m: float = -20e3
    x_origin_raw: int = 50
    y_origin_raw: int = 3000
    report_rate_hz: float = 125.0

    def counts(self, x_m: float, y_m: float) -> tuple[int, int]:
        """Return the place in whole counts."""
        return (
            round(self.x_origin_raw + self.x_counts_per_m * x_m),
            round(self.y_origin_raw + self.y_counts_per_m * y_m),
        )


class SimulatedTouchScreen:
    """One panel, with slots (`slots` > 0, protocol B) or for one finger only.

    Like the kernel it sends only what changed, and no report in which nothing did; reports come at the panel's own
    rate. `descriptor` is where a tracker reads; close it there. When nobody reads, the buffer runs over, and the
    reader learns of it; `lose_events` has the same effect.
    """

    def __init__(self, panel: Panel, *, slots: int = 10, clock: Callable[[], float]) -> None:
        self._panel = panel
        self._slots = slots
        self._clock = clock
        self._sent: dict[tuple[int, tuple[int, int]], int] = {}
        self._contacts = 0
        self._slot = 0
        self._next_report_s = clock()
        self._lost = self._ran_over = False
        self.descriptor, self._output = os.pipe()
        os.set_blocking(self._output, False)

    def current_slot(self) -> int:
        """The slot that the next event without a slot belongs to (EVIOCGABS of ABS_MT_SLOT)."""
        return self._slot

    def put(self, x_m: float, y_m: float, *, finger: int = 0) -> None:
        """Touch, or slide to, a place on the screen; reported when the panel's next report is due."""
        if not self._is_due():
            return
        x_raw, y_raw = self._panel.counts(x_m, y_m)
        down = self._is_down(finger)
        if not down:
            self._contacts += 1
        if self._slots:
            changes = [] if down else [(_ABS_MT_TRACKING_ID, self._contacts)]
            changes += [(_ABS_MT_POSITION_X, x_raw), (_ABS_MT_POSITION_Y, y_raw)]
            self._report(finger, changes, [(_BTN_TOUCH, 1), (_ABS_X, x_raw), (_ABS_Y, y_raw)])
        else:
            self._report(finger, [], [(_BTN_TOUCH, 1), (_ABS_X, x_raw), (_ABS_Y, y_raw)])

    def lift(self, *, finger: int = 0) -> None:
        """Take the finger away; reported at once."""
        if not self._is_down(finger):
            return
        if self._slots:
            others = any(self._is_down(other) for other in range(self._slots) if other != finger)
            self._report(finger, [(_ABS_MT_TRACKING_ID, -1)], [(_BTN_TOUCH, int(others))])
        else:
            self._report(finger, [], [(_BTN_TOUCH, 0)])

    def repeat(self) -> None:
        """Say again all that holds, for a reader that has just come; it would ask the kernel for it instead."""
        events: list[tuple[tuple[int, int], int]] = []
        for finger in sorted({finger for finger, _ in self._sent}):
            if self._slots:
                self._slot = finger
                events.append((_ABS_MT_SLOT, finger))
            events += [(code, value) for (of, code), value in self._sent.items() if of == finger]
        if events:
            self._write([*events, (_SYN_REPORT, 0)])

    def lose_events(self) -> None:
        """Until `find_events`, what happens is not told; the reader learns that something is missing."""
        self._lost = True

    def find_events(self) -> None:
        """Say that events were dropped, as the kernel does, with the end of the report that was under way."""
        self._lost = False
        self._write([(_SYN_DROPPED, 0), (_ABS_X, 1), (_SYN_REPORT, 0)])

    def unplug(self) -> None:
        """End of file at the reader's end."""
        with suppress(OSError):
            os.close(self._output)
        self._output = -1

    def _is_down(self, finger: int) -> bool:
        if self._slots:
            return self._sent.get((finger, _ABS_MT_TRACKING_ID), -1) >= 0
        return self._sent.get((0, _BTN_TOUCH), 0) == 1

    def _is_due(self) -> bool:
        now_s = self._clock()
        if now_s < self._next_report_s:
            return False
        self._next_report_s = now_s + 1.0 / self._panel.report_rate_hz
        return True

    def _report(
        self, finger: int, slotted: list[tuple[tuple[int, int], int]], single: list[tuple[tuple[int, int], int]]
    ) -> None:
        changed = self._changed(finger, slotted)
        if changed and self._slot != finger:
            self._slot = finger
            changed.insert(0, (_ABS_MT_SLOT, finger))
        changed += self._changed(0, single)
        if changed:
            self._write([*changed, (_SYN_REPORT, 0)])

    def _changed(self, finger: int, values: list[tuple[tuple[int, int], int]]) -> list[tuple[tuple[int, int], int]]:
        changed = [(code, value) for code, value in values if self._sent.get((finger, code)) != value]
        self._sent.update({(finger, code): value for code, value in changed})
        return changed

    def _write(self, events: list[tuple[tuple[int, int], int]]) -> None:
        if self._lost or self._output < 0:
            return
        if self._ran_over:
            events = [(_SYN_DROPPED, 0), *events]
        stamp = divmod(round(1e6 * self._clock()), 1_000_000)
        try:
            os.write(self._output, b"".join(_INPUT_EVENT.pack(*stamp, *code, value) for code, value in events))
            self._ran_over = False
        except BlockingIOError:
            self._ran_over = True
