"""A simulated LTS150: speaks APT as bytes, and moves on an injected clock."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple

from hw.stage import apt
from hw.stage.apt import Frame, Message, StatusBit

# The simulator's own table, in millimetres like the data sheet; the driver's limits are not used
# here.
COUNTS_PER_MM = 409_600
VELOCITY_COUNTS_PER_MM_S = 21_987_328
ACCELERATION_COUNTS_PER_MM_S2 = 4506.08
TRAVEL_MM = 150.0
MAX_VELOCITY_MM_S = 50.0
MAX_ACCELERATION_MM_S2 = 50.0
HOMING_VELOCITY_MM_S = 5.0

_UPDATE_INTERVAL_S = 0.1  # of automatic status messages


@dataclass(frozen=True)
class _Motion:
    """A trapezoid from `start_mm` to `end_mm`, and the unasked message at its end."""

    start_s: float
    start_mm: float
    end_mm: float
    velocity_mm_s: float
    acceleration_mm_s2: float
    announce: Message

    @property
    def way_mm(self) -> float:
        """From start to end, with its sign."""
        return self.end_mm - self.start_mm

    @property
    def _peak_mm_s(self) -> float:
        """The velocity reached: a short way is a triangle."""
        return min(self.velocity_mm_s, math.sqrt(self.acceleration_mm_s2 * abs(self.way_mm)))

    @property
    def duration_s(self) -> float:
        """Speed up, go on, slow down."""
        peak = self._peak_mm_s
        return abs(self.way_mm) / peak + peak / self.acceleration_mm_s2 if self.way_mm else 0.0

    def position_mm(self, time_s: float) -> float:
        elapsed_s = min(max(time_s - self.start_s, 0.0), self.duration_s)
        half_s, ramp_s = 0.5 * self.duration_s, self._peak_mm_s / self.acceleration_mm_s2
        near_s = min(elapsed_s, self.duration_s - elapsed_s)  # it is symmetric in time
        near_mm = 0.5 * self.acceleration_mm_s2 * min(near_s, ramp_s) ** 2
        near_mm += self._peak_mm_s * max(near_s - ramp_s, 0.0)
        done_mm = near_mm if elapsed_s < half_s else abs(self.way_mm) - near_mm
        return self.start_mm + math.copysign(done_mm, self.way_mm)

    def speed_mm_s(self, time_s: float) -> float:
        """How fast it is, without a sign."""
        elapsed_s = time_s - self.start_s
        near_s = max(min(elapsed_s, self.duration_s - elapsed_s), 0.0)
        return min(self.acceleration_mm_s2 * near_s, self._peak_mm_s)


class _Speed(NamedTuple):
    velocity_mm_s: float
    acceleration_mm_s2: float


@dataclass
class SimulatedLts150:
    """One stage, as a responder for any transport. Thread-safe.

    It starts somewhere on its travel, not homed, with its counter at 0 there and automatic status
    messages on, as after power-up. Moves beyond the travel end at the travel; velocity and
    acceleration are clipped to the table. A responder cannot speak first, so messages that it sends
    unasked come ahead of the next answer. `has_moved` once it was ordered to.
    """

    clock: Callable[[], float]
    start_mm: float = 40.0
    serial_number: int = 45_000_001
    model: str = "LTS150"
    has_moved: bool = field(default=False, init=False)

    def __post_init__(self) -> None:
        self._lock = threading.Lock()
        self._decoder = apt.Decoder(destination=apt.USB_UNIT, source=apt.HOST)
        self._rest_mm = self.start_mm
        self._counter_zero_mm = self.start_mm
        self._motion: _Motion | None = None
        self._speed = _Speed(20.0, 20.0)
        self._bits = StatusBit(0)
        self._updates, self._next_update_s = True, self.clock()

    @property
    def position_mm(self) -> float:
        """Where the carriage really is."""
        with self._lock:
            return self._position_mm()

    @property
    def moving(self) -> bool:
        """Whether the carriage really moves."""
        with self._lock:
            self._advance()
            return self._motion is not None

    def know_place(self) -> None:
        """Be homed already, as one is that never lost its power."""
        with self._lock:
            self._counter_zero_mm = 0.0
            self._set_bits(StatusBit.HOMED, True)

    def handle(self, data: bytes) -> bytes:
        """Carry out what is complete, and return unasked messages and answers."""
        with self._lock:
            answers = self._unasked()
            for frame in self._decoder.feed(data):
                answers += self._carry_out(frame)
        return b"".join(
            apt.encode(frame, destination=apt.HOST, source=apt.USB_UNIT) for frame in answers
        )

    def _unasked(self) -> list[Frame]:
        frames = self._advance()
        if self._updates and self.clock() >= self._next_update_s:
            self._next_update_s = self.clock() + _UPDATE_INTERVAL_S
            frames.append(apt.with_status(Message.STATUS, self._status()))
        return frames

    def _carry_out(self, frame: Frame) -> list[Frame]:
        match frame.message:
            case Message.REQUEST_INFO:
                return [apt.with_info(apt.Info(self.serial_number, self.model, "1.0.3"))]
            case Message.REQUEST_STATUS:
                return [apt.with_status(Message.STATUS, self._status())]
            case Message.REQUEST_STATUS_BITS:
                return [apt.with_status_bits(self._status().bits)]
            case Message.REQUEST_POSITION:
                return [apt.with_counts(Message.POSITION, self._status().position_raw)]
            case Message.REQUEST_VELOCITY:
                return [apt.with_velocity(Message.VELOCITY, self._velocity())]
            case Message.START_UPDATES | Message.STOP_UPDATES:
                self._updates = frame.message is Message.START_UPDATES
            case Message.SET_CHANNEL_ENABLED:
                self._set_bits(StatusBit.ENABLED, frame.parameter_2 == 1)
            case Message.SET_VELOCITY:
                self._set_velocity(apt.read_velocity(frame))
            case Message.MOVE_HOME:
                self._move(
                    0.0, _Speed(HOMING_VELOCITY_MM_S, self._speed.acceleration_mm_s2), Message.HOMED
                )
            case Message.MOVE_ABSOLUTE:
                target_mm = self._counter_zero_mm + apt.read_counts(frame) / COUNTS_PER_MM
                self._move(target_mm, self._speed, Message.MOVE_COMPLETED)
            case Message.MOVE_RELATIVE:
                target_mm = self._position_mm() + apt.read_counts(frame) / COUNTS_PER_MM
                self._move(target_mm, self._speed, Message.MOVE_COMPLETED)
            case Message.STOP:
                self._stop(frame.parameter_2 == apt.StopMode.IMMEDIATE)
        return []

    def _move(self, target_mm: float, speed: _Speed, announce: Message) -> None:
        if self._motion is not None or not self._bits & StatusBit.ENABLED or min(speed) <= 0.0:
            return
        self.has_moved = True
        target_mm = min(max(target_mm, 0.0), TRAVEL_MM)
        self._set_bits(StatusBit.MOTION_ERROR, False)
        if announce is Message.HOMED:
            self._set_bits(StatusBit.HOMED, False)
        self._motion = _Motion(self.clock(), self._rest_mm, target_mm, *speed, announce)

    def _stop(self, immediate: bool) -> None:
        """Rest here, or where the programmed deceleration leads."""
        motion, now_s = self._motion, self.clock()
        if motion is None:
            return
        here_mm, speed_mm_s = motion.position_mm(now_s), motion.speed_mm_s(now_s)
        slowing_mm = 0.0 if immediate else 0.5 * speed_mm_s**2 / motion.acceleration_mm_s2
        slowing_mm = min(slowing_mm, abs(motion.end_mm - here_mm))
        end_mm = here_mm + math.copysign(slowing_mm, motion.way_mm)
        # A trapezoid whose second half is the slowing down from here.
        start_mm = here_mm - math.copysign(slowing_mm, motion.way_mm)
        peak_mm_s = math.sqrt(2.0 * motion.acceleration_mm_s2 * slowing_mm) or motion.velocity_mm_s
        start_s = now_s - peak_mm_s / motion.acceleration_mm_s2 if slowing_mm else now_s
        self._motion = _Motion(
            start_s, start_mm, end_mm, peak_mm_s, motion.acceleration_mm_s2, Message.STOPPED
        )

    def _advance(self) -> list[Frame]:
        """End the motion that has ended by now, and announce it."""
        motion, now_s = self._motion, self.clock()
        if motion is None or now_s < motion.start_s + motion.duration_s:
            return []
        self._motion = None
        self._rest_mm = motion.end_mm
        if motion.announce is Message.HOMED:
            self._counter_zero_mm = 0.0
            self._set_bits(StatusBit.HOMED, True)
            return [apt.on_channel(Message.HOMED)]
        return [apt.with_status(motion.announce, self._status())]

    def _position_mm(self) -> float:
        self._advance()
        return self._rest_mm if self._motion is None else self._motion.position_mm(self.clock())

    def _status(self) -> apt.MotionStatus:
        position_raw = round((self._position_mm() - self._counter_zero_mm) * COUNTS_PER_MM)
        bits = self._bits
        if self._motion is not None:
            bits |= StatusBit(0x10 if self._motion.way_mm > 0.0 else 0x20)
            if self._motion.announce is Message.HOMED:
                bits |= StatusBit.HOMING
        return apt.MotionStatus(position_raw, bits)

    def _velocity(self) -> apt.Velocity:
        return apt.Velocity(
            round(self._speed.acceleration_mm_s2 * ACCELERATION_COUNTS_PER_MM_S2),
            round(self._speed.velocity_mm_s * VELOCITY_COUNTS_PER_MM_S),
        )

    def _set_velocity(self, velocity: apt.Velocity) -> None:
        self._speed = _Speed(
            min(velocity.velocity_raw / VELOCITY_COUNTS_PER_MM_S, MAX_VELOCITY_MM_S),
            min(velocity.acceleration_raw / ACCELERATION_COUNTS_PER_MM_S2, MAX_ACCELERATION_MM_S2),
        )

    def _set_bits(self, bits: StatusBit, on: bool) -> None:
        self._bits = self._bits | bits if on else self._bits & ~bits
