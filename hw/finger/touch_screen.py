"""A touch screen by its event device (Linux evdev): from the kernel's events to where a finger is,
in metres.
"""

from __future__ import annotations

import datetime
import math
import os
import struct
import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hw.errors import BadReply, DeviceDisconnected, DeviceError
from hw.finger.tracker import FingerReading

Array = NDArray[np.float64]

# struct input_event and codes of linux/input.h and linux/input-event-codes.h
_EVENT = struct.Struct("@llHHi")  # seconds, microseconds, type, code, value
_READ_BYTES = 256 * _EVENT.size
_SYNC, _KEY, _ABSOLUTE = 0x00, 0x01, 0x03
_SYNC_REPORT, _SYNC_DROPPED = 0, 3
_KEY_TOUCH = 0x14A
_X, _Y = 0x00, 0x01
_SLOT, _SLOT_X, _SLOT_Y, _SLOT_CONTACT = 0x2F, 0x35, 0x36, 0x39
_SET_CLOCK = 0x400445A0  # EVIOCSCLOCKID, _IOW('E', 0xa0, int)


class RawTouch(NamedTuple):
    """One report of a touch screen, in its counts."""

    time_s: float
    x_raw: int
    y_raw: int
    touching: bool


@dataclass(frozen=True)
class TouchCalibration:
    """From raw counts to metres on the screen: (x, y) = `matrix_m` @ (x_raw, y_raw, 1), 2x3, metres
    per count.

    `residual_m` is the root mean square distance left by the fit; None where nothing was left over
    to judge by. `placeholder` marks numbers that were never measured on this screen. Raises
    ValueError when no map of a plane.
    """

    matrix_m: tuple[tuple[float, float, float], tuple[float, float, float]]
    measured_on: datetime.date
    placeholder: bool
    residual_m: float | None = None

    def __post_init__(self) -> None:
        """Refuse what is no map."""
        (a, b, c), (d, e, f) = self.matrix_m
        size = math.hypot(a, b) * math.hypot(d, e)
        if not all(map(math.isfinite, (a, b, c, d, e, f))) or abs(a * e - b * d) <= 1e-6 * size:
            raise ValueError(
                f"touch calibration {self.matrix_m} maps the screen onto a line or holds no numbers"
            )

    def apply(self, x_raw: float, y_raw: float) -> tuple[float, float]:
        """Return the position in metres."""
        (a, b, c), (d, e, f) = self.matrix_m
        return a * x_raw + b * y_raw + c, d * x_raw + e * y_raw + f


def fit_calibration(raw: Array, position_m: Array, measured_on: datetime.date) -> TouchCalibration:
    """Least-squares calibration from points touched, `raw` [n, 2] in counts, at places known,
    `position_m` [n, 2].

    Needs three points or more that are not on a line; from four on, the residual says how well they
    agree. Raises ValueError.
    """
    raw, position_m = np.asarray(raw, dtype=np.float64), np.asarray(position_m, dtype=np.float64)
    if raw.ndim != 2 or raw.shape[1:] != (2,) or raw.shape != position_m.shape or len(raw) < 3:
        raise ValueError(
            f"give [n, 2] of each, n at least 3; got {raw.shape} and {position_m.shape}"
        )
    if not (np.isfinite(raw).all() and np.isfinite(position_m).all()):
        raise ValueError("calibration points must be numbers")
    centre = raw.mean(axis=0)
    spread = float(np.abs(raw - centre).max()) or 1.0
    design = np.column_stack([(raw - centre) / spread, np.ones(len(raw))])
    if np.linalg.svd(design, compute_uv=False)[-1] < 1e-3:
        raise ValueError("calibration points are on a line; touch points in three corners or more")
    fitted = np.linalg.lstsq(design, position_m, rcond=None)[0]
    slope = fitted[:2].T / spread
    matrix = np.column_stack([slope, fitted[2] - slope @ centre])
    residual_m = float(np.sqrt(np.mean(np.sum((design @ fitted - position_m) ** 2, axis=1))))
    rows = [(float(a), float(b), float(c)) for a, b, c in matrix]
    return TouchCalibration(
        (rows[0], rows[1]), measured_on, False, residual_m if len(raw) > 3 else None
    )


@dataclass
class _Contact:
    """What is known of one finger; the kernel sends only what changes, so a place may stay unknown
    for a while.
    """

    down: bool
    x_raw: int | None = None
    y_raw: int | None = None

    def report(self, time_s: float) -> RawTouch | None:
        if self.x_raw is None or self.y_raw is None:
            return None
        return RawTouch(time_s, self.x_raw, self.y_raw, self.down)


class TouchEvents:
    """Follows one finger through the kernel's touch events.

    `current_slot` asks a screen with slots (protocol B) which one events belong to; None is for a
    screen that knows one finger only. Of several fingers it follows one until that one lifts, then
    reports the lift, then goes on with the next in slot order. After the kernel has dropped events
    nothing is believed until it is said again: a touch may be missed for a while (on a screen
    without slots until the next one) but is never made up.
    """

    def __init__(self, current_slot: Callable[[], int] | None) -> None:
        self._current_slot = current_slot
        self._fingers: dict[int, _Contact] = {}
        self._slot = self._ask_slot()
        self._followed = self._slot
        self._touched = False  # as last reported
        self._dropping = False
        self._unfinished = b""

    def feed(self, data: bytes) -> RawTouch | None:
        """Take bytes of `struct input_event`, cut anywhere; return the last report with a known
        place.
        """
        data = self._unfinished + data
        whole = len(data) - len(data) % _EVENT.size
        self._unfinished = data[whole:]
        newest = None
        for seconds, microseconds, kind, code, value in _EVENT.iter_unpack(data[:whole]):
            if (kind, code) == (_SYNC, _SYNC_REPORT):
                newest = self._report(seconds + 1e-6 * microseconds) or newest
            elif (kind, code) == (_SYNC, _SYNC_DROPPED):
                self._dropping = True
            elif not self._dropping and self._current_slot is None:
                self._take_single(kind, code, value)
            elif not self._dropping and kind == _ABSOLUTE:
                self._take_slotted(code, value)
        return newest

    def _take_single(self, kind: int, code: int, value: int) -> None:
        finger = self._fingers.setdefault(self._slot, _Contact(down=False))
        if (kind, code) == (_KEY, _KEY_TOUCH):
            finger.down = value != 0
        elif (kind, code) == (_ABSOLUTE, _X):
            finger.x_raw = value
        elif (kind, code) == (_ABSOLUTE, _Y):
            finger.y_raw = value

    def _take_slotted(self, code: int, value: int) -> None:
        if code == _SLOT:
            self._slot = value
        if code not in (_SLOT_CONTACT, _SLOT_X, _SLOT_Y):
            return
        # Only a finger that is down has a place, so an unknown one that is given a place is down.
        finger = self._fingers.setdefault(self._slot, _Contact(down=True))
        if code == _SLOT_CONTACT:
            finger.down = value >= 0
        elif code == _SLOT_X:
            finger.x_raw = value
        else:
            finger.y_raw = value

    def _report(self, time_s: float) -> RawTouch | None:
        if self._dropping:
            return self._forget(time_s)
        if not self._is_down(self._followed) and not self._touched:
            self._followed = min(
                (slot for slot in self._fingers if self._is_down(slot)), default=self._followed
            )
        finger = self._fingers.get(self._followed)
        report = finger.report(time_s) if finger else None
        self._touched = report is not None and report.touching
        return report

    def _forget(self, time_s: float) -> RawTouch | None:
        """Believe nothing any more; a touch so far has ended at its last place."""
        finger = self._fingers.get(self._followed)
        report = finger.report(time_s) if finger else None
        self._fingers.clear()
        self._dropping, self._touched, self._slot = False, False, self._ask_slot()
        return report._replace(touching=False) if report else None

    def _is_down(self, slot: int) -> bool:
        return slot in self._fingers and self._fingers[slot].down

    def _ask_slot(self) -> int:
        return self._current_slot() if self._current_slot else 0


class TouchReports:
    """The reports of a touch screen in its counts, read without waiting.

    `descriptor` gives `struct input_event`, stamped with CLOCK_MONOTONIC. `span_raw` is the range
    of each axis in counts, None where unknown. `name` is for messages; `close` is called once, to
    hang up.
    """

    def __init__(
        self,
        descriptor: int,
        events: TouchEvents,
        *,
        name: str,
        close: Callable[[], None],
        span_raw: tuple[int, int] | None = None,
    ) -> None:
        self.span_raw = span_raw
        self._descriptor = descriptor
        self._events = events
        self._name = name
        self._close = close
        self._newest = RawTouch(-math.inf, 0, 0, False)
        self._is_open = True
        os.set_blocking(descriptor, False)

    def read(self) -> RawTouch:
        """Return the newest report; before the first one its time is -inf. Raises
        DeviceDisconnected.
        """
        if not self._is_open:
            raise DeviceDisconnected(f"{self._name} is closed", "open it again")
        try:
            self._drain()
        except OSError as error:
            raise DeviceDisconnected(
                f"{self._name} is gone ({error})", "plug the touch screen in and open it again"
            ) from error
        return self._newest

    def close(self) -> None:
        """Hang up; does nothing when already closed."""
        if self._is_open:
            self._is_open = False
            self._close()

    def _drain(self) -> None:
        while True:
            try:
                data = os.read(self._descriptor, _READ_BYTES)
            except BlockingIOError:
                return
            if not data:
                raise OSError("end of file")
            self._newest = self._events.feed(data) or self._newest
            if len(data) < _READ_BYTES:
                return


class TouchScreen:
    """A touch screen as a finger tracker: its reports in metres.

    A finger at rest causes no events, so after `still_after_s` without any (several report
    intervals of the screen) a reading says that the place is true now.
    """

    def __init__(
        self,
        reports: TouchReports,
        calibration: TouchCalibration,
        *,
        still_after_s: float = 0.05,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.calibration = calibration
        self._reports = reports
        self._still_after_s = still_after_s
        self._clock = clock
        self._told_s = -math.inf

    def read(self) -> FingerReading:
        """Return the newest reading; times never go back. Raises DeviceDisconnected when the screen
        is gone.
        """
        touch, now_s = self._reports.read(), self._clock()
        self._told_s = max(
            self._told_s, now_s if now_s - touch.time_s > self._still_after_s else touch.time_s
        )
        if touch.time_s == -math.inf:
            return FingerReading(self._told_s, math.nan, math.nan, False)
        return FingerReading(
            self._told_s, *self.calibration.apply(touch.x_raw, touch.y_raw), touch.touching
        )

    def close(self) -> None:
        """Hang up; does nothing when already closed."""
        self._reports.close()


class EvdevTouchScreen:
    """The touch screen at the event device `path`, as a finger tracker between `open` and
    `close`.
    """

    def __init__(self, path: str, calibration: TouchCalibration) -> None:
        self.calibration = calibration
        self._path = path
        self._screen: TouchScreen | None = None

    def open(self) -> None:
        """Open the event device; raises as `open_touch_reports`."""
        if self._screen is None:
            self._screen = TouchScreen(open_touch_reports(self._path), self.calibration)

    def read(self) -> FingerReading:
        """Return the newest reading, as `TouchScreen.read`. Raises DeviceDisconnected when not
        open.
        """
        if self._screen is None:
            raise DeviceDisconnected(f"{self._path} is not open", "call open() first")
        return self._screen.read()

    def close(self) -> None:
        """Hang up; does nothing when already closed."""
        screen, self._screen = self._screen, None
        if screen is not None:
            screen.close()


def open_touch_reports(path: str) -> TouchReports:
    """Open the event device at `path`, e.g. `/dev/input/by-id/...-event`, on the monotonic clock.

    Needs the package evdev. Raises DeviceError, DeviceDisconnected or BadReply.
    """
    try:
        import fcntl  # noqa: PLC0415 - not on Windows

        import evdev  # noqa: PLC0415 - optional
    except ImportError as error:
        raise DeviceError(
            "a touch screen needs the package evdev (Linux only)",
            "pip install 'haptic-driver[touch]'",
        ) from error
    try:
        with ExitStack() as on_failure:
            device = evdev.InputDevice(path, readonly=True)
            on_failure.callback(device.close)
            fcntl.ioctl(device.fd, _SET_CLOCK, struct.pack("@i", time.CLOCK_MONOTONIC))
            has_slots = _has_slots(device, path)
            events = TouchEvents((lambda: int(device.absinfo(_SLOT).value)) if has_slots else None)
            x, y = (
                device.absinfo(code) for code in ((_SLOT_X, _SLOT_Y) if has_slots else (_X, _Y))
            )
            on_failure.pop_all()
    except OSError as error:
        raise DeviceDisconnected(
            f"{path} cannot be opened as a touch screen ({error})",
            "check the path under /dev/input/by-id, and that you may read it (group input)",
        ) from error
    return TouchReports(
        device.fd,
        events,
        name=path,
        close=device.close,
        span_raw=(int(x.max - x.min), int(y.max - y.min)),
    )


def _has_slots(device: Any, path: str) -> bool:
    """Whether an evdev device tells fingers apart by slots, or knows one only; BadReply for no
    touch screen.
    """
    can = device.capabilities(absinfo=False)
    axes = set(can.get(_ABSOLUTE, []))
    if {_SLOT, _SLOT_X, _SLOT_Y, _SLOT_CONTACT} <= axes:
        return True
    if {_X, _Y} <= axes and _KEY_TOUCH in can.get(_KEY, []):
        return False
    raise BadReply(
        f"{path} is {device.name!r}, which is no touch screen", "choose another event device"
    )
