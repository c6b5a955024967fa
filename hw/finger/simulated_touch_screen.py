"""A simulated touch screen: writes the kernel's `struct input_event` to a file, as an event device
gives them.
"""

from __future__ import annotations

import datetime
import os
import struct
from collections.abc import Callable
from dataclasses import dataclass

from hw.finger.touch_screen import TouchCalibration

# 64-bit Linux: seconds, microseconds, type, code, value. The simulator's own table of codes.
_INPUT_EVENT = struct.Struct("<qqHHi")
SYN_REPORT, SYN_DROPPED = (0x00, 0x00), (0x00, 0x03)
BTN_TOUCH = (0x01, 0x14A)
TOUCH_N = 0.02  # from this force on the screen feels the finger
ABS_X, ABS_Y = (0x03, 0x00), (0x03, 0x01)

Event = tuple[tuple[int, int], int]  # ((type, code), value)


@dataclass(frozen=True)
class Panel:
    """The panel's geometry: counts per metre along each axis, counts at the origin; a mirrored axis
    counts down.
    """

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


PANEL = Panel(
    x_counts_per_m=100e3,
    y_counts_per_m=-100e3,
    x_origin_raw=50,
    y_origin_raw=6050,
    report_rate_hz=250.0,
)
"""Of simulated rigs."""
# counts of PANEL to metres, exact by construction
SCREEN = TouchCalibration(
    ((1e-5, 0.0, -50e-5), (0.0, -1e-5, 6050e-5)), datetime.date(2024, 1, 1), placeholder=False
)


class SimulatedTouchScreen:
    """One panel for one finger.

    Like the kernel it sends only what changed, and no report in which nothing did; reports come at
    the panel's own rate. `descriptor` is where a tracker reads; close it there, and `output`, where
    this writes, when it has ended. When nobody reads, the buffer runs over, and the reader learns
    of it.
    """

    def __init__(self, panel: Panel, *, clock: Callable[[], float]) -> None:
        self._panel = panel
        self._clock = clock
        self._sent: dict[tuple[int, int], int] = {}
        self._next_report_s = clock()
        self._ran_over = False
        self.descriptor, self.output = os.pipe()
        os.set_blocking(self.output, False)

    def put(self, x_m: float, y_m: float) -> None:
        """Touch, or slide to, a place on the screen; reported when the panel's next report is
        due.
        """
        now_s = self._clock()
        if now_s >= self._next_report_s:
            self._next_report_s = now_s + 1.0 / self._panel.report_rate_hz
            self._touch(*self._panel.counts(x_m, y_m))

    def lift(self) -> None:
        """Take the finger away; reported at once."""
        if self._sent.get(BTN_TOUCH):
            self._report([(BTN_TOUCH, 0)])

    def repeat(self) -> None:
        """Say again all that holds, for a reader that has just come; it would ask the kernel for it
        instead.
        """
        if self._sent:
            self._write([*self._sent.items(), (SYN_REPORT, 0)])

    def _touch(self, x_raw: int, y_raw: int) -> None:
        self._report([(BTN_TOUCH, 1), (ABS_X, x_raw), (ABS_Y, y_raw)])

    def _report(self, values: list[Event]) -> None:
        changed = [(code, value) for code, value in values if self._sent.get(code) != value]
        self._sent.update(changed)
        if changed:
            self._write([*changed, (SYN_REPORT, 0)])

    def _write(self, events: list[Event]) -> None:
        if self._ran_over:
            events = [(SYN_DROPPED, 0), *events]
        stamp = divmod(round(1e6 * self._clock()), 1_000_000)
        try:
            os.write(
                self.output,
                b"".join(_INPUT_EVENT.pack(*stamp, *code, value) for code, value in events),
            )
            self._ran_over = False
        except BlockingIOError:
            self._ran_over = True
