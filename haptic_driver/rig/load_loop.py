"""The load controller on a stage and a force sensor.

Each look asks the sensor, then the stage, and carries out the order. The loop lets go (retracts or
stops, as its settings say) on every way out of its `with` block: what fails, Ctrl-C too. A process
that is killed leaves a stage that finishes one short move and rests, until the watchdog has it let
go.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from typing import TYPE_CHECKING, Protocol, Self

from haptic_driver.errors import HapticError
from haptic_driver.rig.load_controller import (
    ARRIVED_M,
    Act,
    LoadSettings,
    LoadState,
    Order,
    Phase,
    Seen,
    step,
)
from hw.errors import DeviceError, DeviceTimeout
from hw.force.sensor import ForceSensor
from hw.health import Health
from hw.stage.letting_go import Mounting, let_go

if TYPE_CHECKING:  # who reads a rig's file does not wait for devices
    from hw.stage.lts150 import StageStatus

PERIOD_S = 0.01  # between looks, where the devices answer faster
HOMING_S = 60.0  # [unverified] of the slowest homing
LET_GO_S = 5.0  # for the stage to rest
SETTLED_S = 0.3  # over which a load is averaged before it is believed
SETTLED_SHARE = 0.05

LEFT_LOOKS = 10  # at the load, after letting go


def settled(load_n: float, target_n: float) -> bool:
    """Whether a load is that one, as near as it is held."""
    return abs(load_n - target_n) <= SETTLED_SHARE * target_n


class LoadStage(Protocol):
    """A stage along the normal; `hw.stage.lts150.Lts150` is one. Every method may raise
    DeviceError.
    """

    def read_status(self) -> StageStatus:
        """Where it is, and whether it moves."""

    def set_velocity(self, velocity_m_s: float, acceleration_m_s2: float) -> None:
        """For the moves to come."""

    def move_to(self, position_m: float) -> None:
        """Start a move."""

    def wait(self, timeout_s: float) -> StageStatus:
        """Wait until the move has arrived; any error stops the stage first."""

    def home(self) -> None:
        """Start to look for the home position, at the lower end."""

    def stop(self) -> StageStatus:
        """Stop and return the status at rest."""


class LoadSensor(ForceSensor, Protocol):
    """A force sensor and how well it answers, by the clock of whoever asks it."""

    @property
    def health(self) -> Health:
        """Of its newest reading."""


class Guard(Protocol):
    """Who lets go if this program dies; `hw.safety.watchdog.Watchdog` is one."""

    def press(self) -> None:
        """The stage will press. Raises DeviceError where nobody guards."""

    def lifted(self) -> None:
        """The stage has let go."""


def is_clear(status: StageStatus, mounting: Mounting) -> bool:
    """Whether a stage shows that it rests where the finger is free."""
    here_m, clear_m = mounting.depth_m(status.position_m), mounting.depth_m(mounting.clear_m)
    known = status.homed and not status.motion_error
    return known and not status.moving and here_m <= clear_m + ARRIVED_M


def make_clear(
    stage: LoadStage, mounting: Mounting, wanted: Callable[[], bool] | None = None
) -> None:
    """Bring the stage to where the finger is free, homed if need be. Once that is not `wanted` any
    more it stops.

    HapticError for one that has stopped so, and for one that is not homed where homing would
    press. Raises DeviceError.
    """
    if not stage.read_status().homed:
        if mounting.towards < 0:
            raise HapticError(
                "not_homed",
                "the load stage is not homed, and homing, to its lower end, would press",
                "Take the finger and its holder out, home the stage, then start again",
            )
        stage.home()
        _arrive(stage, wanted)
    stage.set_velocity(mounting.retract_m_s, mounting.acceleration_m_s2)
    stage.move_to(mounting.clear_m)
    _arrive(stage, wanted)


def clear_for_bias(stage: LoadStage, mounting: Mounting, *, retract: bool) -> None:
    """Lift a stage off that stands where it may press, so that a force sensor's bias hides no load.

    One that is not homed is left alone: it does not know where it stands. HapticError for one that
    may press and is not to retract. Raises DeviceError.
    """
    status = stage.read_status()
    if not status.homed or is_clear(status, mounting):
        return
    if not retract:
        raise HapticError(
            "may_press",
            f"the load stage stands at {1e3 * status.position_m:.2f} mm and may press: the force"
            " sensor's bias would hide it",
            f"Move it by hand to {1e3 * mounting.clear_m:.2f} mm, where the finger is free",
        )
    stage.stop()
    make_clear(stage, mounting)


def _arrive(stage: LoadStage, wanted: Callable[[], bool] | None) -> None:
    """See `make_clear`. Each look waits for the stage's answer."""
    until_s = time.monotonic() + HOMING_S
    while wanted is not None and stage.read_status().moving:
        if not wanted():
            stage.stop()
            raise HapticError("load_let_go", "no load is wanted any more", "Then start again")
        if time.monotonic() > until_s:
            stage.stop()
            said = f"the load stage says that it moves, for more than {HOMING_S:g} s"
            raise DeviceTimeout(said, "Look whether it is blocked")
    stage.wait(HOMING_S)


def lift(stage: LoadStage, mounting: Mounting, guard: Guard | None, *, retract: bool) -> None:
    """Let go, and return when the stage rests. Raises DeviceError."""
    let_go(stage, mounting, retract=retract)
    if retract:
        stage.wait(LET_GO_S)
    if guard is not None:
        guard.lifted()


class LoadLoop:
    """Holds a load while `look` is called, again and again, between entering and leaving.

    The stage stands clear when this is made; earlier readings of the sensor do not count.
    `last_m` is where the finger was felt the last time, if it was: `touch_m` of the loop before.
    """

    def __init__(
        self,
        stage: LoadStage,
        sensor: LoadSensor,
        settings: LoadSettings,
        mounting: Mounting,
        *,
        clock: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], object] = time.sleep,
        guard: Guard | None = None,
        last_m: float | None = None,
    ) -> None:
        self.settings = settings
        self.state = LoadState(clear_s=clock(), last_m=last_m)
        self.load_n = math.nan  # the newest
        self.depth_m = math.nan
        self._stage = stage
        self._sensor = sensor
        self._mounting = mounting
        self._clock = clock
        self._sleep = sleep
        self._guard = guard
        self._trouble = ""  # what a device said last that failed
        self.rests = True  # shown: the stage has let go and rests, or has not begun
        self._released = True  # the stage took the order to let go
        self._speed_m_s = math.nan  # of the stage's moves, as set
        self._due_s = -math.inf

    def look(self) -> LoadState:
        """Wait until the next look is due, look, and have the stage do what follows.

        Raises no DeviceError: a device that fails ends the loop, and the state says why.
        """
        self._sleep(max(self._due_s - self._clock(), 0.0))
        self._due_s = self._clock() + PERIOD_S
        self.state, order = step(self.settings, self.state, self._see())
        try:
            self._carry_out(order)
        except DeviceError as error:
            if self.state.phase is not Phase.ENDED:
                self.state = replace(
                    self.state, phase=Phase.ENDED, reason=f"the load stage: {error}"
                )
            self.let_go()
        return self.state

    def hold(self, duration_s: float) -> None:
        """Look for so long, at least once. HapticError, with the stage letting go, when the loop
        ends.
        """
        end_s = self._clock() + duration_s
        while True:
            if self.look().phase is Phase.ENDED:
                raise self._ended()
            if self._clock() >= end_s:
                return

    @property
    def touch_m(self) -> float | None:
        """The depth at which the finger was first felt; None while it is not."""
        return None if self.state.touch is None else self.state.touch.depth_m

    @property
    def reason(self) -> str:
        """Why the loop has ended, with what a device said."""
        return f"{self.state.reason} ({self._trouble})" if self._trouble else self.state.reason

    def _ended(self) -> HapticError:
        why = self.reason
        if self._released:
            said = f"the load stage let go: {why}"
            return HapticError("load_let_go", said, "Remove the cause, then start again")
        said = f"the load stage may still press, and takes no order: {why}"
        return HapticError(
            "load_presses", said, "Lift the finger off by hand, switch the stage off"
        )

    def average(self, duration_s: float) -> tuple[float, float]:
        """Mean load in N and depth in m while it is held for so long; HapticError as `hold`."""
        end_s, looks, load_n, depth_m = self._clock() + duration_s, 0, 0.0, 0.0
        while self._clock() < end_s:
            self.hold(0.0)
            looks += 1
            load_n += (self.load_n - load_n) / looks
            depth_m += (self.depth_m - depth_m) / looks
        return load_n, depth_m

    def settle(self, timeout_s: float) -> None:
        """Hold until the load's mean over `SETTLED_S` is within `SETTLED_SHARE` of the target;
        HapticError when it is not in time, or as `hold`.
        """
        target_n, began_s = self.settings.target_n, self._clock()
        while self._clock() - began_s <= timeout_s:
            loads, until_s = [], self._clock() + SETTLED_S
            while self._clock() < until_s:
                self.hold(0.0)
                loads.append(self.load_n)
            mean_n = sum(loads) / len(loads)
            held = self.state.phase is Phase.HOLD
            if held and settled(mean_n, target_n):
                return
        raise HapticError(
            "load_missed",
            f"the load is {self.load_n:.2f} N after {timeout_s:g} s, not {target_n:g} N",
            "Look at the finger's stiffness in the rig's file: haptic load tune",
        )

    def let_go(self) -> bool:
        """Retract or stop, without asking the sensor; whether the stage took it. Never raises
        DeviceError.
        """
        try:
            self._let_go(retract=self.settings.retracts)
        except DeviceError:
            self._released = False
        return self._released

    def doubt(self) -> str:
        """Why the load that was held is in doubt: by what is still felt after letting go. Empty
        where nothing is, or the finger was not felt or not lifted. Raises DeviceError.
        """
        if self.touch_m is None or not (self.rests and self.settings.retracts):
            return ""
        loads = []
        for _ in range(LEFT_LOOKS):
            self._sleep(PERIOD_S)
            loads.append(self._sensor.read().normal_force_n)
        left_n = sum(loads) / len(loads)
        if abs(left_n) < self.settings.touch_n:
            return ""
        return (
            f"after letting go {left_n:.2f} N are still felt: the force sensor's zero has moved,"
            " or something else touches"
        )

    def __enter__(self) -> Self:
        """Raises DeviceError where the guard does not guard."""
        if self._guard is not None:
            self._guard.press()
        self.rests = False
        return self

    def __exit__(self, *_: object) -> None:
        """Let go, also of a loop that has ended: its stage may not have taken the order. Returns
        when the stage rests.
        """
        with suppress(DeviceError):
            lift(self._stage, self._mounting, self._guard, retract=self.settings.retracts)
            self.rests = True

    def _see(self) -> Seen:
        load_n = None
        with self._noted():
            load_n = self.load_n = self._sensor.read().normal_force_n
        # before the stage is asked, whose answer may take its time
        health = self._sensor.health
        age_s = health.age_s(self._clock())
        depth_m, moving = None, False
        with self._noted():
            status = self._stage.read_status()
            moving = status.moving
            if not status.homed or status.motion_error:
                self._trouble = "it is not homed any more, or reports a motion error"
            else:
                depth_m = self.depth_m = self._mounting.depth_m(status.position_m)
        now_s = self._clock()
        return Seen(now_s, load_n, age_s, health.saturated, depth_m, moving, health.same_s)

    @contextmanager
    def _noted(self) -> Iterator[None]:
        """A device that fails is no reading; its message is kept for the report."""
        try:
            yield
        except DeviceError as error:
            self._trouble = error.message

    def _carry_out(self, order: Order) -> None:
        match order.act:
            case Act.MOVE:
                self._move(order.depth_m, order.speed_m_s)
            case Act.STOP | Act.RETRACT:
                self._let_go(retract=order.act is Act.RETRACT)

    def _move(self, depth_m: float, speed_m_s: float) -> None:
        if speed_m_s != self._speed_m_s:
            self._stage.set_velocity(speed_m_s, self._mounting.acceleration_m_s2)
            self._speed_m_s = speed_m_s
        self._stage.move_to(self._mounting.position_m(depth_m))

    def _let_go(self, *, retract: bool) -> None:
        self._speed_m_s = math.nan
        let_go(self._stage, self._mounting, retract=retract)
        self._released = True
