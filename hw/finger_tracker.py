"""Where the finger is on the touch screen, from whatever the rig has: a touch screen, a stage, or a recording."""

from __future__ import annotations

import datetime
import fcntl
import math
import os
import struct
import threading
import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from hw.errors import BadReply, DeviceDisconnected, DeviceError, DeviceTimeout
from hw.running import Running
from hw.stage import StageStatus

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


class FingerReading(NamedTuple):
    """One reading: when the position was true (CLOCK_MONOTONIC), the position in screen coordinates, and touch.

    Before the first touch the position is NaN; after a lift it is the last one.
    """

    time_s: float
    position_x_m: float
    position_y_m: float
    touching: bool


class FingerTracker(Protocol):
    """A source of finger positions."""

    def read(self) -> FingerReading:
        """Return the newest reading without waiting. Raises DeviceError."""


@dataclass(frozen=True)
class TouchCalibration:
    """From raw counts to metres on the screen: (x, y) = `matrix_m` @ (x_raw, y_raw, 1), 2x3, metres per count.

    `residual_m` is the root mean square distance left by the fit; None where nothing was left over to judge by.
    `placeholder` marks numbers that were never measured on this screen. Raises ValueError when no map of a plane.
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
            raise ValueError(f"touch calibration {self.matrix_m} maps the screen onto a line or holds no numbers")

    def apply(self, x_raw: float, y_raw: float) -> tuple[float, float]:
        """Return the position in metres."""
        (a, b, c), (d, e, f) = self.matrix_m
        return a * x_raw + b * y_raw + c, d * x_raw + e * y_raw + f


def fit_calibration(raw: Array, position_m: Array, measured_on: datetime.date) -> TouchCalibration:
    """Least-squares calibration from points touched, `raw` [n, 2] in counts, at places known, `position_m` [n, 2].

    Needs three points or more that are not on a line; from four on, the residual says how well they agree. Raises
    ValueError.
    """
    raw, position_m = np.asarray(raw, dtype=np.float64), np.asarray(position_m, dtype=np.float64)
    if raw.ndim != 2 or raw.shape[1:] != (2,) or raw.shape != position_m.shape or len(raw) < 3:
        raise ValueError(f"give [n, 2] of each, n at least 3; got {raw.shape} and {position_m.shape}")
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
    return TouchCalibration((rows[0], rows[1]), measured_on, False, residual_m if len(raw) > 3 else None)


def placeholder_calibration(
    x_range_raw: tuple[int, int], y_range_raw: tuple[int, int], width_m: float, height_m: float, on: datetime.date
) -> TouchCalibration:
    """The panel's range of counts spread over the size of the screen, until somebody measures. Raises ValueError."""
    (x_low, x_high), (y_low, y_high) = x_range_raw, y_range_raw
    if not (x_high > x_low and y_high > y_low):
        raise ValueError(f"the ranges {x_range_raw} and {y_range_raw} must be ordered")
    x_scale, y_scale = width_m / (x_high - x_low), height_m / (y_high - y_low)
    return TouchCalibration(((x_scale, 0.0, -x_scale * x_low), (0.0, y_scale, -y_scale * y_low)), on, placeholder=True)


@dataclass
class _Contact:
    """What is known of one finger; the kernel sends only what changes, so a place may stay unknown for a while."""

    down: bool
    x_raw: int | None = None
    y_raw: int | None = None

    def report(self, time_s: float) -> RawTouch | None:
        if self.x_raw is None or self.y_raw is None:
            return None
        return RawTouch(time_s, self.x_raw, self.y_raw, self.down)


class RawTouch(NamedTuple):
    """One report of a touch screen, in its counts."""

    time_s: float
    x_raw: int
    y_raw: int
    touching: bool


class TouchEvents:
    """Follows one finger through the kernel's touch events.

    `current_slot` asks a screen with slots (protocol B) which one events belong to; None is for a screen that knows
    one finger only. Of several fingers it follows one until that one lifts, then reports the lift, then goes on with
    the next in slot order. After the kernel has dropped events nothing is believed until it is said again: a touch
    may be missed for a while (on a screen without slots until the next one) but is never made up.
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
        """Take bytes of `struct input_event`, cut anywhere; return the last report with a known place."""
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
            self._followed = min((slot for slot in self._fingers if self._is_down(slot)), default=self._followed)
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


class TouchScreen:
    """A touch screen by its event device, read without waiting.

    `descriptor` gives `struct input_event`, stamped with CLOCK_MONOTONIC. A finger at rest causes no events, so
    after `still_after_s` without any (several report intervals of the screen) a reading says that the place is true
    now. `name` is for messages; `close` is called once, to hang up.
    """

    def __init__(
        self,
        descriptor: int,
        events: TouchEvents,
        calibration: TouchCalibration,
        *,
        name: str,
        close: Callable[[], None],
        still_after_s: float = 0.05,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.calibration = calibration
        self._descriptor = descriptor
        self._events = events
        self._name = name
        self._close = close
        self._still_after_s = still_after_s
        self._clock = clock
        self._newest = RawTouch(-math.inf, 0, 0, False)
        self._told_s = -math.inf
        self._is_open = True
        os.set_blocking(descriptor, False)

    def read(self) -> FingerReading:
        """Return the newest reading; times never go back. Raises DeviceDisconnected when the screen is gone."""
        if not self._is_open:
            raise DeviceDisconnected(f"{self._name} is closed", "open it again")
        try:
            self._drain()
        except OSError as error:
            raise DeviceDisconnected(
                f"{self._name} is gone ({error})", "plug the touch screen in and open it again"
            ) from error
        now_s, touch = self._clock(), self._newest
        self._told_s = max(self._told_s, now_s if now_s - touch.time_s > self._still_after_s else touch.time_s)
        if touch.time_s == -math.inf:
            return FingerReading(self._told_s, math.nan, math.nan, False)
        return FingerReading(self._told_s, *self.calibration.apply(touch.x_raw, touch.y_raw), touch.touching)

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


def open_touch_screen(path: str, calibration: TouchCalibration) -> TouchScreen:
    """Open the event device at `path`, e.g. `/dev/input/by-id/...-event`, on the monotonic clock.

    Needs the package evdev. Raises DeviceError, DeviceDisconnected or BadReply.
    """
    try:
        import evdev  # noqa: PLC0415 - optional
    except ImportError as error:
        raise DeviceError(
            "a touch screen needs the package evdev (Linux only)", "pip install 'haptic-driver[touch]'"
        ) from error
    try:
        with ExitStack() as on_failure:
            device = evdev.InputDevice(path, readonly=True)
            on_failure.callback(device.close)
            fcntl.ioctl(device.fd, _SET_CLOCK, struct.pack("@i", time.CLOCK_MONOTONIC))
            events = TouchEvents(_question_for_slot(device, path))
            on_failure.pop_all()
    except OSError as error:
        raise DeviceDisconnected(
            f"{path} cannot be opened as a touch screen ({error})",
            "check the path under /dev/input/by-id, and that you may read it (group input)",
        ) from error
    return TouchScreen(device.fd, events, calibration, name=path, close=device.close)


def _question_for_slot(device: Any, path: str) -> Callable[[], int] | None:
    """How to ask an evdev device for its slot, None when it knows one finger only; BadReply for no touch screen."""
    can = device.capabilities(absinfo=False)
    axes = set(can.get(_ABSOLUTE, []))
    if {_SLOT, _SLOT_X, _SLOT_Y, _SLOT_CONTACT} <= axes:
        return lambda: int(device.absinfo(_SLOT).value)
    if {_X, _Y} <= axes and _KEY_TOUCH in can.get(_KEY, []):
        return None
    raise BadReply(f"{path} is {device.name!r}, which is no touch screen", "choose another event device")


class StageFinger(Running):
    """A finger carried by a stage: its position on a line across the screen, polled in a thread of its own.

    `origin_m` is the place on the screen at stage position 0, `direction` the unit vector of a move forward.
    `touching` says only that the position is known (the stage is homed): contact is for the force sensor to tell.
    Runs between `start` and `close`, or inside a `with` block. The stage stays connected and is not stopped.
    """

    def __init__(
        self,
        read_status: Callable[[], StageStatus],
        *,
        origin_m: tuple[float, float],
        direction: tuple[float, float] = (1.0, 0.0),
        interval_s: float = 0.005,
        stale_after_s: float = 0.2,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        if not abs(math.hypot(*direction) - 1.0) < 1e-3:
            raise ValueError(f"stage direction {direction} must be a unit vector")
        self._read_status = read_status
        self._origin_m, self._direction = origin_m, direction
        self._interval_s, self._stale_after_s = interval_s, stale_after_s
        self._clock = clock
        self._newest: StageStatus | None = None
        self._error: DeviceError | None = None
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._poll, name="stage position", daemon=True)

    def start(self) -> None:
        """Ask once, then go on asking in the background. Raises DeviceError."""
        self._newest = self._read_status()
        self._thread.start()

    def close(self) -> None:
        """Stop asking."""
        self._ended.set()
        if self._thread.is_alive():
            self._thread.join()

    def read(self) -> FingerReading:
        """Return the newest position. Raises what ended the polling, and DeviceTimeout when the newest is too old."""
        if self._error is not None:
            raise type(self._error)(self._error.message, self._error.hint) from self._error
        status = self._newest
        if status is None or self._clock() - status.time_s > self._stale_after_s:
            raise DeviceTimeout(f"the stage has told no position for {self._stale_after_s:g} s", "start it; try again")
        if not status.homed:
            return FingerReading(status.time_s, math.nan, math.nan, False)
        x_m, y_m = (o + d * status.position_m for o, d in zip(self._origin_m, self._direction, strict=True))
        return FingerReading(status.time_s, x_m, y_m, True)

    def _poll(self) -> None:
        while not self._ended.wait(self._interval_s):
            try:
                self._newest = self._read_status()
            except DeviceError as error:
                self._error = error
                return


class RecordedFinger:
    """A slide played back in real time from the first reading on; arrays [n], times rising, positions in metres.

    Each reading is the newest recorded sample, with its time moved to `clock`. After the end the finger has lifted
    at the last place. Raises ValueError for arrays that are no recording.
    """

    def __init__(
        self,
        time_s: Array,
        position_x_m: Array,
        position_y_m: Array,
        touching: NDArray[np.bool_],
        *,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        shapes = {np.shape(column) for column in (time_s, position_x_m, position_y_m, touching)}
        if len(shapes) != 1 or np.ndim(time_s) != 1 or len(time_s) < 1:
            raise ValueError(f"a recording has four columns of one length, not {sorted(shapes)}")
        if not (np.all(np.isfinite(time_s)) and np.all(np.diff(time_s) > 0.0)):
            raise ValueError("the times of a recording must be numbers and rise")
        self._time_s = np.asarray(time_s) - time_s[0]
        self._columns = position_x_m, position_y_m, touching
        self._clock = clock
        self._began_s: float | None = None

    def read(self) -> FingerReading:
        """Return the sample that is due."""
        now_s = self._clock()
        self._began_s = now_s if self._began_s is None else self._began_s
        i = int(np.searchsorted(self._time_s, now_s - self._began_s, side="right")) - 1
        x_m, y_m, touching = (column[i] for column in self._columns)
        if now_s - self._began_s > self._time_s[-1]:
            return FingerReading(now_s, float(x_m), float(y_m), False)
        return FingerReading(self._began_s + float(self._time_s[i]), float(x_m), float(y_m), bool(touching))
