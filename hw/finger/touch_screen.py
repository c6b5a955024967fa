"""A touch screen by its event device (Linux evdev): from the kernel's events to where a finger is,
in metres.
"""

from __future__ import annotations

import datetime
import math
import os
import re
import socket
import struct
import time
from collections.abc import Callable, Sequence, Set
from contextlib import ExitStack
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from hw.errors import BadReply, DeviceDisconnected, DeviceError
from hw.finger.tracker import FingerReading

# struct input_event and codes of linux/input.h and linux/input-event-codes.h
_EVENT = struct.Struct("@llHHi")  # seconds, microseconds, type, code, value
_READ_BYTES = 256 * _EVENT.size
_ADDRESS = re.compile(r"[^/]+:\d+")
_CONNECT_S = 2.0
_STILL_AFTER_S = 0.05  # several report intervals of a screen
_SYNC, _KEY, _ABSOLUTE = 0x00, 0x01, 0x03
_SYNC_REPORT, _SYNC_DROPPED = 0, 3
_KEY_TOUCH = 0x14A
_PEN_KEYS = (0x140, 0x141, 0x142, 0x143, 0x144)  # BTN_TOOL_PEN to BTN_TOOL_AIRBRUSH
_X, _Y, _PRESSURE, _DISTANCE = 0x00, 0x01, 0x18, 0x19
_SLOT, _SLOT_X, _SLOT_Y, _SLOT_CONTACT = 0x2F, 0x35, 0x36, 0x39
_SLOT_TOOL, _SLOT_DISTANCE = 0x37, 0x3B
_SLOT_MAJOR, _SLOT_MINOR, _SLOT_PRESSURE = 0x30, 0x31, 0x3A
_SLOT_AXES = {_SLOT_CONTACT, _SLOT_X, _SLOT_Y, _SLOT_TOOL, _SLOT_DISTANCE, _SLOT_MAJOR}
_SLOT_AXES |= {_SLOT_MINOR, _SLOT_PRESSURE}
_FINGER, _PEN, _PALM = 0, 1, 2  # MT_TOOL_FINGER, MT_TOOL_PEN, MT_TOOL_PALM
_SET_CLOCK = 0x400445A0  # EVIOCSCLOCKID, _IOW('E', 0xa0, int)
_SLOT_VALUES = 0x8000450A  # EVIOCGMTSLOTS(0), to which the size of the answer is added at bit 16


class RawTouch(NamedTuple):
    """One report of a touch screen, in its counts. `axes_raw2` is the product of the contact's
    longer and shorter axis, 0 where it is not told.
    """

    time_s: float
    x_raw: int
    y_raw: int
    touching: bool
    axes_raw2: int = 0


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


class Standing(NamedTuple):
    """What holds of each slot besides its place, from slot 0 on; the kernel repeats none of it.

    `distance_raw` from the screen, 0 for a touch; `tool` as MT_TOOL_*. Pressure and the axes of
    contact, the longer and the shorter one, are 0 for what does not touch.
    """

    distance_raw: Sequence[int] = ()
    tool: Sequence[int] = ()
    pressure_raw: Sequence[int] = ()
    major_raw: Sequence[int] = ()
    minor_raw: Sequence[int] = ()


@dataclass
class _Contact:
    """What is known of one finger; the kernel sends only what changes, so a place may stay unknown
    for a while.
    """

    down: bool
    x_raw: int | None = None
    y_raw: int | None = None
    distance_raw: int = 0
    tool: int = _FINGER
    lifted_by_key: bool = False  # its slot has not said so
    is_told: bool = False  # in this report
    major_raw: int = 0
    minor_raw: int | None = None  # None: as long as the longer one
    weightless: set[int] = field(default_factory=set)
    telling: Set[int] = frozenset()

    @property
    def on_screen(self) -> bool:
        """Whether skin is on the screen. A pen is none, nor is what hovers, or has no pressure or
        no area by an axis of `telling`.
        """
        is_near = self.distance_raw <= 0 and not self.weightless & self.telling
        return self.down and is_near and self.tool != _PEN

    @property
    def touching(self) -> bool:
        """Whether it is a finger on the screen, which a palm is not."""
        return self.on_screen and self.tool == _FINGER

    def report(self, time_s: float) -> RawTouch | None:
        if self.x_raw is None or self.y_raw is None:
            return None
        minor_raw = self.major_raw if self.minor_raw is None else self.minor_raw
        axes_raw2 = max(self.major_raw, 0) * max(minor_raw, 0)
        return RawTouch(time_s, self.x_raw, self.y_raw, self.touching, axes_raw2)


class TouchEvents:
    """Follows one finger through the kernel's touch events.

    `current_slot` asks a screen with slots (protocol B) which one events belong to; None is for a
    screen that knows one finger only. Of several fingers it follows one until that one lifts, then
    reports the lift, then goes on with the next in slot order. What hovers, a palm and a pen are no
    touch, and BTN_TOUCH 0 lifts every finger, whatever its slot says. Neither is what has no
    pressure or no area, on a screen that has ever told some by that axis.

    After the kernel has dropped events, only what the screen reports again is believed. A touch may
    be missed for a while (on a screen without slots until the next one), but is never made up.
    `standing` then asks the screen for what it would not repeat.

    `contacts` and `palm` are of the last report, as in `FingerReading`.
    """

    def __init__(
        self, current_slot: Callable[[], int] | None, standing: Callable[[], Standing] = Standing
    ) -> None:
        self._current_slot = current_slot
        self._ask_standing = standing
        self._standing = standing()
        self._fingers: dict[int, _Contact] = {}
        self._slot = self._ask_slot()
        self._followed = self._slot
        self._touched = False  # as last reported
        self._is_key_up = False  # BTN_TOUCH 0, on a screen with slots
        self._dropping = False
        self._unfinished = b""
        self.contacts: int | None = None if current_slot is None else 0
        self.palm = False
        self._telling: set[int] = set()  # axes of pressure and area that have been above 0

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
            elif not self._dropping:
                self._take_slotted(kind, code, value)
        return newest

    def _take_single(self, kind: int, code: int, value: int) -> None:
        finger = self._contact(down=False)
        if (kind, code) == (_KEY, _KEY_TOUCH):
            finger.down = value != 0
        elif kind == _KEY and code in _PEN_KEYS:
            finger.tool = _PEN if value else _FINGER
        elif (kind, code) == (_ABSOLUTE, _DISTANCE):
            finger.distance_raw = value
        elif (kind, code) == (_ABSOLUTE, _PRESSURE):
            self._weigh(finger, code, value)
        elif (kind, code) == (_ABSOLUTE, _X):
            finger.x_raw = value
        elif (kind, code) == (_ABSOLUTE, _Y):
            finger.y_raw = value

    def _take_slotted(self, kind: int, code: int, value: int) -> None:
        if (kind, code) == (_KEY, _KEY_TOUCH):
            self._is_key_up = value == 0
        if kind != _ABSOLUTE:
            return
        if code == _SLOT:
            self._slot = value
        if code not in _SLOT_AXES:
            return
        # Only a finger that is down has a place, so an unknown one that is given a place is down.
        finger = self._contact(down=code in (_SLOT_X, _SLOT_Y))
        finger.is_told = True
        if code == _SLOT_CONTACT:
            finger.down, finger.lifted_by_key = value >= 0, False
        elif code == _SLOT_X:
            finger.x_raw = value
        elif code == _SLOT_Y:
            finger.y_raw = value
        elif code == _SLOT_TOOL:
            finger.tool = value
        elif code == _SLOT_DISTANCE:
            finger.distance_raw = value
        elif code == _SLOT_MINOR:
            finger.minor_raw = value
        else:
            self._weigh(finger, code, value)

    def _weigh(self, finger: _Contact, code: int, value: int) -> None:
        """Take a pressure or an area. An axis that was never above 0 tells nothing."""
        if code == _SLOT_MAJOR:
            finger.major_raw = value
        if value > 0:
            self._telling.add(code)
            finger.weightless.discard(code)
        else:
            finger.weightless.add(code)

    def _contact(self, *, down: bool) -> _Contact:
        """The finger that the events are of; `down` where it is not known yet."""
        if self._slot not in self._fingers:
            distance_raw, tool, pressure_raw, major_raw, minor_raw = (
                values[self._slot] if 0 <= self._slot < len(values) else None
                for values in self._standing
            )
            finger = _Contact(down, distance_raw=distance_raw or 0, tool=tool or _FINGER)
            finger.minor_raw = minor_raw
            finger.telling = self._telling
            pressure = _PRESSURE if self._current_slot is None else _SLOT_PRESSURE
            for code, value in ((pressure, pressure_raw), (_SLOT_MAJOR, major_raw)):
                if value is not None:
                    self._weigh(finger, code, value)
            self._fingers[self._slot] = finger
        return self._fingers[self._slot]

    def _settle(self) -> None:
        """Take BTN_TOUCH together with what the slots have said in the same report.

        A touch that it lifted without an event of its slot counts again after the slot's next
        event.
        """
        for finger in self._fingers.values():
            if self._is_key_up:
                finger.lifted_by_key |= finger.down
                finger.down = False
            elif finger.lifted_by_key and finger.is_told:
                finger.down, finger.lifted_by_key = True, False
            finger.is_told = False

    def _report(self, time_s: float) -> RawTouch | None:
        if self._dropping:
            return self._forget(time_s)
        self._settle()
        self._count()
        if not self._is_down(self._followed) and not self._touched:
            self._followed = min(
                (slot for slot in self._fingers if self._is_down(slot)), default=self._followed
            )
        finger = self._fingers.get(self._followed)
        report = finger.report(time_s) if finger else None
        self._touched = report is not None and report.touching
        return report

    def _count(self) -> None:
        there = [finger for finger in self._fingers.values() if finger.on_screen]
        self.palm = any(finger.tool == _PALM for finger in there)
        if self._current_slot is not None:
            self.contacts = len(there)

    def _forget(self, time_s: float) -> RawTouch | None:
        """Believe nothing any more; a touch so far has ended at its last place."""
        finger = self._fingers.get(self._followed)
        report = finger.report(time_s) if finger else None
        self._fingers.clear()
        self._count()
        self._standing = self._ask_standing()
        self._dropping, self._touched, self._slot = False, False, self._ask_slot()
        self._is_key_up = False
        return report._replace(touching=False) if report else None

    def _is_down(self, slot: int) -> bool:
        return slot in self._fingers and self._fingers[slot].touching

    def _ask_slot(self) -> int:
        return self._current_slot() if self._current_slot else 0


class TouchReports:
    """The reports of a touch screen in its counts, read without waiting.

    `descriptor` gives `struct input_event`, stamped with CLOCK_MONOTONIC. `span_raw` is the range
    of each axis in counts, None where unknown; `tells_area`: whether it tells how large a contact
    is, None where unknown. `name` is for messages; `close` is called once, to hang up.
    """

    def __init__(
        self,
        descriptor: int,
        events: TouchEvents,
        *,
        name: str,
        close: Callable[[], None],
        span_raw: tuple[int, int] | None = None,
        tells_area: bool | None = None,
    ) -> None:
        self.span_raw, self.tells_area = span_raw, tells_area
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

    @property
    def contacts(self) -> tuple[int | None, bool]:
        """How many touch, and whether a palm does, by the newest report; see `FingerReading`."""
        return self._events.contacts, self._events.palm

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


class AreaCalibration(NamedTuple):
    """The contact area is `m2_per_raw2` times the product of the axes of contact, in counts.

    `log_std` is the standard deviation of its logarithm.
    """

    m2_per_raw2: float
    log_std: float

    def area_m2(self, touch: RawTouch) -> tuple[float, float]:
        """With its standard deviation; NaN where the touch does not tell it."""
        area_m2 = self.m2_per_raw2 * touch.axes_raw2 if touch.axes_raw2 > 0 else math.nan
        return area_m2, self.log_std * area_m2


class TouchScreen:
    """A touch screen as a finger tracker: its reports in metres.

    A finger at rest causes no events. So after 50 ms without any (several report intervals of the
    screen), a reading carries the present time.
    """

    def __init__(
        self,
        reports: TouchReports,
        calibration: TouchCalibration,
        area: AreaCalibration | None = None,
        *,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.calibration = calibration
        self._area = area
        self._reports = reports
        self._clock = clock
        self._told_s = -math.inf

    def read(self) -> FingerReading:
        """Return the newest reading; times never go back. Raises DeviceDisconnected when the screen
        is gone.
        """
        touch, now_s = self._reports.read(), self._clock()
        self._told_s = max(
            self._told_s, now_s if now_s - touch.time_s > _STILL_AFTER_S else touch.time_s
        )
        place_m = (math.nan, math.nan)
        if touch.time_s > -math.inf:
            place_m = self.calibration.apply(touch.x_raw, touch.y_raw)
        area = (math.nan, math.nan) if self._area is None else self._area.area_m2(touch)
        return FingerReading(self._told_s, *place_m, touch.touching, *self._reports.contacts, *area)

    def close(self) -> None:
        """Hang up; does nothing when already closed."""
        self._reports.close()


class EvdevTouchScreen:
    """The touch screen at the event device `path`, as a finger tracker between `open` and
    `close`.
    """

    def __init__(
        self, path: str, calibration: TouchCalibration, area: AreaCalibration | None = None
    ) -> None:
        self.calibration = calibration
        self.area = area
        self._path = path
        self._screen: TouchScreen | None = None

    def open(self) -> None:
        """Open the event device; raises as `open_touch_reports`."""
        if self._screen is None:
            self._screen = TouchScreen(open_touch_reports(self._path), self.calibration, self.area)

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

    `host:port` sends the events of one, stamped by this machine's clock. An event device needs the
    package evdev. Raises DeviceError, DeviceDisconnected or BadReply.
    """
    if _ADDRESS.fullmatch(path):
        return _reports_over_tcp(path)
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
            events = TouchEvents(
                (lambda: int(device.absinfo(_SLOT).value)) if has_slots else None,
                lambda: _standing(device, has_slots),
            )
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
        tells_area=has_slots and _SLOT_MAJOR in _codes(device, _ABSOLUTE),
    )


def _reports_over_tcp(address: str) -> TouchReports:
    host, port = address.rsplit(":", 1)
    try:
        connection = socket.create_connection((host, int(port)), _CONNECT_S)
    except OSError as error:
        said = f"no touch screen answers at {address} ({error})"
        raise DeviceDisconnected(said, "start what sends its events") from error
    close = connection.close
    return TouchReports(connection.fileno(), TouchEvents(None), name=address, close=close)


def _has_slots(device: Any, path: str) -> bool:
    """Whether an evdev device reports fingers in slots, or one finger only. BadReply for no touch
    screen, and for one that reports several fingers without slots (multi-touch protocol A).
    """
    axes = _codes(device, _ABSOLUTE)
    if {_SLOT, _SLOT_X, _SLOT_Y, _SLOT_CONTACT} <= axes:
        return True
    if {_SLOT_X, _SLOT_Y} & axes:
        raise BadReply(
            f"{path} is {device.name!r}, a screen that tells several fingers without slots"
            " (multi-touch protocol A): its touches cannot be followed",
            "Use a screen whose driver has slots (evtest lists ABS_MT_SLOT and"
            " ABS_MT_TRACKING_ID), set it to one finger if it can be (ABS_X, ABS_Y and BTN_TOUCH"
            " alone), or convert its events to slots with the library mtdev and a uinput device",
        )
    if {_X, _Y} <= axes and _KEY_TOUCH in _codes(device, _KEY):
        return False
    raise BadReply(
        f"{path} is {device.name!r}, which is no touch screen", "choose another event device"
    )


def _codes(device: Any, kind: int) -> set[int]:
    """What events of a kind it can send: which axes, or which keys."""
    return set(device.capabilities(absinfo=False).get(kind, []))


def _standing(device: Any, has_slots: bool) -> Standing:
    """What an evdev device knows of its fingers besides their place."""
    axes = _codes(device, _ABSOLUTE)
    if has_slots:
        asked = _SLOT_DISTANCE, _SLOT_TOOL, _SLOT_PRESSURE, _SLOT_MAJOR, _SLOT_MINOR
        return Standing(*(_slot_values(device, c) if c in axes else () for c in asked))
    distance_raw = int(device.absinfo(_DISTANCE).value) if _DISTANCE in axes else 0
    pressure_raw = [int(device.absinfo(_PRESSURE).value)] if _PRESSURE in axes else []
    pens = _codes(device, _KEY) & set(_PEN_KEYS)
    has_pen = bool(pens and pens & set(device.active_keys()))
    return Standing([distance_raw], [_PEN if has_pen else _FINGER], pressure_raw)


def _slot_values(device: Any, code: int) -> Sequence[int]:
    """One axis of every slot, as the kernel has it now."""
    import fcntl  # noqa: PLC0415 - not on Windows

    slots = int(device.absinfo(_SLOT).max) + 1
    layout = struct.Struct(f"@i{slots}i")
    answer = bytearray(layout.pack(code, *[0] * slots))
    fcntl.ioctl(device.fd, _SLOT_VALUES | layout.size << 16, answer)
    return [int(value) for value in layout.unpack(answer)[1:]]
