"""A Thorlabs LTS150 linear stage, polled over the APT protocol."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from contextlib import AbstractContextManager, suppress
from dataclasses import dataclass
from typing import NamedTuple

from hw.errors import BadReply, DeviceError, DeviceTimeout, LimitExceeded
from hw.setting import Setting
from hw.stage import apt
from hw.stage.apt import Message, StatusBit
from hw.transport.contract import Transport

# share by which a velocity read back may differ, for what the instrument rounds
_VELOCITY_TOLERANCE = 1e-3
_LONGEST_COUNT = 2**31 - 1  # of the protocol's 32 bits
_RESET_PULSE_S = 0.05  # RTS high at opening, then low (as pylablib's Kinesis back end does)
_LOCK_TIMEOUT_S = 5.0  # longer than any one question with its answer


@dataclass(frozen=True)
class StageSettings:
    """What the stage is and may do. Travel, velocity and acceleration are the rig's: [unverified]
    150 mm, 50 mm/s.

    The scales are counts per SI unit as the controller takes them: 409600 counts per mm. Velocity
    is scaled by 53.68 more, acceleration by 53.68 * 204.94e-6 (Thorlabs APT protocol, p. 39-41).
    `model` is what the instrument's name must begin with. The stage counts as stalled when it rests
    away from its target for `settle_time_s`; a pause of `write_gap_s` keeps messages apart. Raises
    ValueError for numbers that make no sense.
    """

    travel_low_m: float
    travel_high_m: float
    velocity_m_s: float
    acceleration_m_s2: float
    velocity_limit_m_s: float
    acceleration_limit_m_s2: float
    model: str = "LTS150"
    counts_per_m: float = 409_600e3
    counts_per_m_s: float = 409_600e3 * 53.68
    counts_per_m_s2: float = 409_600e3 * 53.68 * 204.94e-6
    position_tolerance_m: float = 10e-6
    reply_timeout_s: float = 1.0
    stop_timeout_s: float = 3.0
    settle_time_s: float = 0.3
    poll_interval_s: float = 0.02
    write_gap_s: float = 0.003

    def __post_init__(self) -> None:
        """Refuse what cannot be a stage."""
        positive = {
            k: v
            for k, v in vars(self).items()
            if k not in ("travel_low_m", "travel_high_m", "model")
        }
        for name, value in positive.items():
            if not (math.isfinite(value) and value > 0.0):
                raise ValueError(f"stage {name} must be a finite number > 0, not {value!r}")
        if not -math.inf < self.travel_low_m < self.travel_high_m < math.inf:
            raise ValueError(
                f"stage travel {self.travel_low_m:g}..{self.travel_high_m:g} m must be finite and"
                " ordered"
            )
        if (
            self.velocity_m_s > self.velocity_limit_m_s
            or self.acceleration_m_s2 > self.acceleration_limit_m_s2
        ):
            raise ValueError(
                "stage velocity_m_s and acceleration_m_s2 must not be beyond their limits"
            )
        for name, counts in (
            ("travel", max(abs(self.travel_low_m), abs(self.travel_high_m)) * self.counts_per_m),
            ("velocity_limit_m_s", self.velocity_limit_m_s * self.counts_per_m_s),
            ("acceleration_limit_m_s2", self.acceleration_limit_m_s2 * self.counts_per_m_s2),
        ):
            if counts > _LONGEST_COUNT:
                raise ValueError(
                    f"stage {name} is {counts:.3g} counts, more than the protocol's 32 bits; in SI"
                    " units?"
                )


class StageStatus(NamedTuple):
    """What the stage says of itself: time of the answer on the driver's clock, position, and
    whether anything moves.
    """

    time_s: float
    position_m: float
    moving: bool
    homed: bool
    motion_error: bool


class Lts150:
    """Driver of one stage. Positions are metres from the home position.

    The stage is polled; messages that it sends unasked are passed over. A move is started, and
    `wait` sees it through; hanging up does not end a move, so whatever goes wrong during `wait`
    stops the stage. Safe to call from several threads: `stop` goes between the polls of a `wait`.
    Every method raises DeviceError unless it says otherwise. `set_rts` drives the line that resets
    the interface at opening (`SerialTransport.set_rts`; it may answer that there is no such line);
    None leaves the line alone.
    """

    def __init__(
        self,
        transport: Transport,
        settings: StageSettings,
        *,
        set_rts: Callable[[bool], bool] | None = None,
        clock: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        self.settings = settings
        self._transport = transport
        self._set_rts = set_rts
        self._clock = clock
        self._sleep = sleep
        self._last_write_s = -math.inf
        self._target_m: float | None = None

    def connect(self) -> apt.Info:
        """Open, check the identity, silence automatic messages, enable, set the velocity; never
        moves the stage.

        A move that was under way goes on, and `read_status` shows it.
        """
        self._transport.open()
        if self._set_rts is not None:
            self._set_rts(True)
            self._sleep(_RESET_PULSE_S)
            self._set_rts(False)
        for message in (Message.NO_FLASH, Message.STOP_UPDATES):
            self._send(apt.Frame(message))
        info = self.identify()
        if not info.model.startswith(self.settings.model):
            raise BadReply(
                f"{self._transport.resource} is {info.model!r}, serial number {info.serial_number},"
                f" not a {self.settings.model}",
                "check the port and the model in the configuration",
            )
        self._send(apt.on_channel(Message.SET_CHANNEL_ENABLED, 1))
        self.set_velocity(self.settings.velocity_m_s, self.settings.acceleration_m_s2)
        return info

    def identify(self) -> apt.Info:
        """Only ask what it is, over a transport that is open."""
        return apt.read_info(self._ask(apt.Frame(Message.REQUEST_INFO), Message.INFO))

    def read_status(self) -> StageStatus:
        """Ask where the stage is and what it does."""
        status = apt.read_status(self._ask(apt.on_channel(Message.REQUEST_STATUS), Message.STATUS))
        return StageStatus(
            time_s=self._clock(),
            position_m=status.position_raw / self.settings.counts_per_m,
            moving=bool(status.bits & apt.ANY_MOTION),
            homed=bool(status.bits & StatusBit.HOMED),
            motion_error=bool(status.bits & StatusBit.MOTION_ERROR),
        )

    def set_velocity(self, velocity_m_s: float, acceleration_m_s2: float) -> None:
        """Set both for the moves to come, and read them back. Raises LimitExceeded with nothing
        sent.
        """
        settings = self.settings
        _check_range(
            self._transport.resource,
            "velocity",
            "m/s",
            velocity_m_s,
            0.0,
            settings.velocity_limit_m_s,
        )
        _check_range(
            self._transport.resource,
            "acceleration",
            "m/s²",
            acceleration_m_s2,
            0.0,
            settings.acceleration_limit_m_s2,
        )
        wanted = apt.Velocity(
            round(acceleration_m_s2 * settings.counts_per_m_s2),
            round(velocity_m_s * settings.counts_per_m_s),
        )
        if min(wanted) < 1:
            raise LimitExceeded(
                f"{self._transport.resource}: {velocity_m_s:g} m/s and {acceleration_m_s2:g} m/s²"
                " are below one count",
                "choose more; to stand still, stop",
            )
        with self._undisturbed():
            self._send(apt.with_velocity(Message.SET_VELOCITY, wanted))
            held = self._ask_velocity()
        if any(
            abs(got - want) > _VELOCITY_TOLERANCE * want + 1.0
            for got, want in zip(held, wanted, strict=True)
        ):
            raise BadReply(
                f"{self._transport.resource} holds {held} where {wanted} counts were set",
                "the stage refuses them, or the scale in the configuration is another model's",
            )

    def held(self) -> list[Setting]:
        """Only ask: velocity and acceleration that are set at connecting, and that are set now."""
        held, settings = self._ask_velocity(), self.settings
        return [
            Setting(
                "velocity_m_s", settings.velocity_m_s, held.velocity_raw / settings.counts_per_m_s
            ),
            Setting(
                "acceleration_m_s2",
                settings.acceleration_m_s2,
                held.acceleration_raw / settings.counts_per_m_s2,
            ),
        ]

    def _ask_velocity(self) -> apt.Velocity:
        return apt.read_velocity(
            self._ask(apt.on_channel(Message.REQUEST_VELOCITY), Message.VELOCITY)
        )

    def home(self) -> None:
        """Start to look for the home position; follow with `wait`."""
        with self._undisturbed():
            self._check_at_rest(self.read_status())
            self._target_m = None
            self._send(apt.on_channel(Message.MOVE_HOME))

    def move_to(self, position_m: float) -> None:
        """Start a move; follow with `wait`.

        Raises LimitExceeded, with no move sent, outside the travel; DeviceError unless homed and at
        rest.
        """
        target_m = self._within_travel(position_m)
        with self._undisturbed():
            status = self.read_status()
            self._check_at_rest(status)
            if not status.homed:
                raise self._failed(
                    status, "is not homed, so its position means nothing", "home it first"
                )
            self._target_m = target_m
            self._send(
                apt.with_counts(Message.MOVE_ABSOLUTE, round(target_m * self.settings.counts_per_m))
            )

    def wait(self, timeout_s: float) -> StageStatus:
        """Wait until the move or homing that was started has arrived.

        Raises DeviceTimeout after `timeout_s`, and DeviceError when the stage rests elsewhere or
        reports a fault. Any error or interrupt stops the stage first.
        """
        deadline_s = self._clock() + timeout_s
        try:
            return self._wait(deadline_s, timeout_s)
        except BaseException:
            with suppress(DeviceError):
                self.stop()
            raise

    def stop(self) -> StageStatus:
        """Stop with the programmed deceleration, at once if that does not help, and return the
        status at rest.

        Raises DeviceTimeout when the stage still moves, or what kept the order or the question from
        it.
        """
        try:
            status = self._stop(apt.StopMode.PROFILED)
        except DeviceError:
            status = None
        if status is None or status.moving:
            status = self._stop(apt.StopMode.IMMEDIATE)
        if status.moving:
            raise DeviceTimeout(
                f"{self._transport.resource} still moves after the order to stop",
                "switch the stage off by hand",
            )
        return status

    def close(self) -> bool:
        """Stop and hang up. Returns True only when the stage said that it rests. Never raises
        DeviceError.
        """
        at_rest = True
        try:
            self.stop()
        except DeviceError:
            at_rest = False
        self._transport.close()
        return at_rest

    def _stop(self, mode: apt.StopMode) -> StageStatus:
        """Tell the stage to stop, and return its status at rest, or after the stop timeout."""
        deadline_s = self._clock() + self.settings.stop_timeout_s
        self._send(apt.on_channel(Message.STOP, mode))
        status = self.read_status()
        while status.moving and status.time_s < deadline_s:
            self._sleep(self.settings.poll_interval_s)
            status = self.read_status()
        return status

    def _wait(self, deadline_s: float, timeout_s: float) -> StageStatus:
        at_rest_since_s = self._clock()
        while True:
            status = self.read_status()
            if status.motion_error:
                raise self._failed(status, "reports a motion error", "free the stage, then home it")
            rests_s = status.time_s - at_rest_since_s
            if status.moving:
                at_rest_since_s = status.time_s
            elif self._has_arrived(status, rests_s):
                return status
            elif rests_s > self.settings.settle_time_s:
                raise self._failed(
                    status,
                    "rests without having arrived",
                    "it was stopped, is blocked or not enabled",
                )
            if status.time_s > deadline_s:
                raise DeviceTimeout(
                    f"{self._transport.resource} has not arrived after {timeout_s:g} s",
                    "allow more time, or a higher velocity",
                )
            self._sleep(self.settings.poll_interval_s)

    def _has_arrived(self, status: StageStatus, rests_s: float) -> bool:
        """At the target; or homed and at rest for a while, as the bit may still be from an earlier
        homing.
        """
        if self._target_m is None:
            return status.homed and rests_s > self.settings.settle_time_s
        return abs(status.position_m - self._target_m) <= self.settings.position_tolerance_m

    def _check_at_rest(self, status: StageStatus) -> None:
        if status.moving:
            raise self._failed(status, "moves already", "wait for it or stop it")

    def _failed(self, status: StageStatus, what: str, hint: str) -> DeviceError:
        return DeviceError(
            f"{self._transport.resource} {what}; it is at {1e3 * status.position_m:.3f} mm", hint
        )

    def _within_travel(self, position_m: float) -> float:
        """Return the position; less than half a count outside, the end of travel, as sums of floats
        come out so.
        """
        low_m, high_m = self.settings.travel_low_m, self.settings.travel_high_m
        nearest_m = min(max(position_m, low_m), high_m)
        if abs(position_m - nearest_m) < 0.5 / self.settings.counts_per_m:
            return nearest_m
        _check_range(self._transport.resource, "position", "m", position_m, low_m, high_m)
        return position_m

    def _send(self, frame: apt.Frame) -> None:
        with self._undisturbed():
            gap_s = self._last_write_s + self.settings.write_gap_s - self._clock()
            if gap_s > 0.0:
                self._sleep(gap_s)
            self._transport.write(apt.encode(frame))
            self._last_write_s = self._clock()

    def _ask(self, question: apt.Frame, answer: Message) -> apt.Frame:
        """Send a question and return the first message of the answer's kind, whatever else comes
        before.

        After a failure a late answer may still come, so the transport is then dirty.
        """
        with self._undisturbed():
            try:
                self._send(question)
                return self._receive(answer)
            except BaseException:
                self._transport.mark_dirty()
                raise

    def _receive(self, answer: Message) -> apt.Frame:
        deadline_s = self._clock() + self.settings.reply_timeout_s
        decoder = apt.Decoder()
        while (left_s := deadline_s - self._clock()) > 0.0:
            for frame in decoder.feed(self._transport.read_exactly(decoder.missing_bytes, left_s)):
                if frame.message is answer:
                    return frame
        raise DeviceTimeout(
            f"{self._transport.resource} did not answer in time: no {answer.name} within"
            f" {self.settings.reply_timeout_s:g} s, though other messages came",
            "check that this is the stage",
        )

    def _undisturbed(self) -> AbstractContextManager[None]:
        """Hold the transport over several messages."""
        return self._transport.exchange(_LOCK_TIMEOUT_S)


def _check_range(
    resource: str, what: str, unit: str, value: float, low: float, high: float
) -> None:
    if not low <= value <= high:
        raise LimitExceeded(
            f"{resource}: {what} {value:g} {unit} is outside {low:g}..{high:g}; it was not sent",
            f"the nearest is {high if value > high else low:g} {unit}",
        )
