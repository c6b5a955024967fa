"""The load of a finger under the daemon: a thread holds it by the rig's load stage.

It does so while who asked for it has the lease, and until somebody switches off.

Whoever switches off only withdraws the right to press, and never waits for the stage: the thread
looks at that right about every 10 ms. The force sensor has one reader, which fills the shared
memory; the loop takes its readings from there.
"""

from __future__ import annotations

import math
import threading
from collections import deque
from collections.abc import Callable
from typing import NamedTuple

from haptic_driver.daemon.event_log import EventLog
from haptic_driver.daemon.messages import LoadPhase, LoadStatus
from haptic_driver.daemon.orders import Orders
from haptic_driver.errors import BadInputError, message_of
from haptic_driver.processes.shared_memory import Sensed, SharedState
from haptic_driver.processes.started import start_thread
from haptic_driver.rig.config import RigConfig
from haptic_driver.rig.devices import Devices
from haptic_driver.rig.load_controller import LoadSettings, Phase, Seen, wrong_load
from haptic_driver.rig.load_loop import (
    Guard,
    LoadLoop,
    LoadSensor,
    LoadStage,
    is_clear,
    lift,
    make_clear,
)
from haptic_driver.rig.parts.load_stages import LoadStageSection
from hw.errors import DeviceError, DeviceTimeout
from hw.force.sensor import ForceReading
from hw.health import Health

IDLE_S = 0.02  # between looks for somebody who wants a load
AGAIN_S = 0.5  # between looks at a stage that rests, and attempts to lift one that took no order
GUARDED_S = 1.0  # between looks whether somebody would lift the finger if this process died
EXCHANGE_S = 15.0  # for the thread to let go of a stage, by its own timeouts

SAID = {
    LoadPhase.FREE: "has let go",
    LoadPhase.STOPPED: "stays where it stopped, and may touch",
    LoadPhase.MAY_PRESS: "may still press",
}


class Wanted(NamedTuple):
    """A load, for one arming, until somebody switches off."""

    settings: LoadSettings
    arming: int
    withdrawn: int


class SensedForce:
    """The force sensor as its one reader, `Instruments.read`, hears and believes it."""

    def __init__(self, shared: SharedState, clock: Callable[[], float]) -> None:
        self.read_by: LoadSensor | None = None  # of the devices that are connected
        self._shared, self._clock = shared, clock

    @property
    def newest(self) -> Sensed:
        """What was believed last."""
        return self._shared.sensed.read()

    @property
    def health(self) -> Health:
        """That of the sensor; a reading that nobody believed was not heard."""
        known = Health("force_sensor") if self.read_by is None else self.read_by.health
        return known._replace(heard_s=self.newest.force_time_s)

    @property
    def silent(self) -> str:
        """For how long too long; empty while it is heard."""
        age_s = self.health.age_s(self._clock())
        return "" if age_s <= LoadSettings.silent_s else f"its newest reading is {age_s:.2f} s old"

    def read(self) -> ForceReading:
        """The newest reading. DeviceTimeout for one that is stale."""
        sensed = self.newest
        if silent := self.silent:
            raise DeviceTimeout(silent)
        return ForceReading(
            sensed.force_time_s, sensed.normal_force_n, sensed.lateral_force_n, sensed.saturated
        )


class HeldLoad:
    """Holds a load while it is wanted; thread-safe. `exchange` gives it the devices.

    `using` is held by whoever moves the stage. On a rig without a load stage it refuses.
    """

    def __init__(
        self,
        config: RigConfig,
        shared: SharedState,
        orders: Orders,
        events: EventLog,
        clock: Callable[[], float],
    ) -> None:
        section = config.load_stage
        self._section = section if isinstance(section, LoadStageSection) else None
        self._rig = config.name
        self._shared, self._orders, self._events, self._clock = shared, orders, events, clock
        self._stage: LoadStage | None = None
        self._sensor = SensedForce(shared, clock)
        self._guard: Guard | None = None
        self._using = threading.Lock()
        self._wanted: Wanted | None = None
        self._phase = LoadPhase.FREE
        self._loop: LoadLoop | None = None  # from the approach until the stage rests
        self._unsure = False  # whether the stage has let go
        self._last_m: float | None = None  # where the finger was last felt
        self._failures: deque[str] = deque()  # to be told as faults

    @property
    def _rest(self) -> LoadPhase:
        """The phase of a stage that has let go as its section says."""
        section = self._section
        retracts = section is None or section.when_wrong == "retract"
        return LoadPhase.FREE if retracts else LoadPhase.STOPPED

    @property
    def present(self) -> bool:
        """Whether the rig has a load stage."""
        return self._section is not None

    def start(self, ending: threading.Event) -> list[threading.Thread]:
        """Begin, if there is a load stage; the thread lets go and ends once `ending` is set."""
        return [start_thread("press", self._run, ending)] if self.present else []

    def exchange(self, devices: Devices | None) -> None:
        """Another stage from here on, or none; waits while the one before is let go. A stage that
        does not show that it stands clear may press: the thread lifts it.
        """
        free = self._using.acquire(timeout=EXCHANGE_S)
        try:
            self._stage = None if devices is None else devices.load_stage
            self._sensor.read_by = None if devices is None else devices.force_sensor
            self._guard = None if devices is None else devices.watchdog
            if self._stage is not None:
                self._unsure = not self._stands_clear(self._stage)
                self._phase = LoadPhase.MAY_PRESS if self._unsure else LoadPhase.FREE
        finally:
            if free:
                self._using.release()

    def _stands_clear(self, stage: LoadStage) -> bool:
        section = self._section
        try:
            return section is not None and is_clear(stage.read_status(), section.mounting())
        except DeviceError:
            return False

    # --- what the API asks

    def hold(self, token: str, newtons: float) -> None:
        """Begin to press, and return; the status tells how far it is. Raises BadInputError for a
        load or a rig that cannot be, RefusedError without the lease.
        """
        if self._section is None:
            raise BadInputError(
                "no_load_stage",
                f"rig {self._rig} has no load stage: the load is the finger's own",
                "Take rig simulated-paper, or add a section [load_stage] to the rig's file",
            )
        settings = self._section.loop(newtons)
        orders = self._orders
        with orders.lock:
            orders.renew(token)
            wanted = Wanted(settings, orders.machine.arming, orders.withdrawn)
            if wanted != self._wanted:
                self._wanted = wanted
        self._events.tell("load", f"a load of {newtons:g} N is wanted", load_n=newtons)

    def release(self) -> None:
        """No load is wanted any more; the stage lets go within moments."""
        self._wanted = None

    def status(self, load_n: float | None) -> LoadStatus | None:
        """What the stage does, beside the load that is measured; None without a load stage."""
        if self._section is None:
            return None
        wanted, loop, phase = self._wanted, self._loop, self._phase
        if phase is LoadPhase.HOLD and loop is not None:
            phase = {
                Phase.APPROACH: LoadPhase.APPROACH,
                Phase.HOLD: LoadPhase.HOLD,
                Phase.ENDED: LoadPhase.LETTING_GO,
            }[loop.state.phase]
        is_wanted = wanted is not None and self._is_wanted(wanted)
        pressed = None if loop is None else loop.settings
        if phase in (LoadPhase.APPROACH, LoadPhase.HOLD) and not (
            wanted is not None and is_wanted and wanted.settings == pressed
        ):
            phase = LoadPhase.LETTING_GO  # also of another load, for the one that is wanted
        depth_m = math.nan if loop is None else loop.depth_m
        return LoadStatus(
            phase=phase,
            target_n=wanted.settings.target_n if wanted is not None and is_wanted else None,
            load_n=None if self._sensor.silent else load_n,
            depth_m=depth_m if math.isfinite(depth_m) else None,
        )

    def watch(self) -> None:
        """Fault where the loop has ended by itself, or the load is beyond what lets go, however
        long the stage takes to answer.
        """
        loop, wanted = self._loop, self._wanted
        if loop is not None and wanted is not None and self._is_wanted(wanted):
            ended = loop.state.phase is Phase.ENDED
            self._fail(loop.reason if ended else self._wrong(loop.settings))
        while self._failures:
            self._fail(self._failures.popleft())

    def _fail(self, why: str) -> None:
        if why:
            self._orders.fail(f"the load stage lets go: {why}")

    def _wrong(self, settings: LoadSettings) -> str:
        """Why the load that is measured now has to be let go; empty while it has not."""
        sensor, now_s = self._sensor, self._clock()
        health, load_n = sensor.health, sensor.newest.normal_force_n
        age_s, same_s = health.age_s(now_s), health.same_s
        return wrong_load(
            settings, Seen(now_s, load_n, age_s, health.saturated, None, False, same_s)
        )

    # --- the thread

    def _run(self, ending: threading.Event) -> None:
        tried_s = -math.inf
        while not ending.is_set():
            wanted = self._wanted
            if wanted is not None and self._is_wanted(wanted):
                self._press(wanted, ending)
            elif self._clock() - tried_s >= AGAIN_S:
                if self._unsure:
                    self._lift()
                else:
                    self._look()
                tried_s = self._clock()
            ending.wait(IDLE_S)

    def _is_wanted(self, wanted: Wanted) -> bool:
        """Waits for nobody: each of these alone ends it."""
        orders, machine = self._orders, self._orders.machine
        return (
            self._wanted is wanted
            and machine.armed
            and machine.arming == wanted.arming
            and orders.withdrawn == wanted.withdrawn
            and self._clock() <= machine.lease_until_s
        )

    def _press(self, wanted: Wanted, ending: threading.Event) -> None:
        """Clear, approach, hold and let go. What fails is a fault, but for what nobody wants any
        more.
        """

        def goes_on() -> bool:
            return self._is_wanted(wanted) and not ending.is_set()

        section = self._section
        assert section is not None  # or no thread
        with self._using:
            try:
                stage = self._stage
                if stage is None:
                    raise DeviceTimeout("it is not connected")
                mounting = section.mounting()
                self._phase = LoadPhase.CLEARING
                make_clear(stage, mounting, goes_on)
                self._unsure = False
                loop = LoadLoop(
                    stage,
                    self._sensor,
                    wanted.settings,
                    mounting,
                    clock=self._clock,
                    guard=self._guard,
                    last_m=self._last_m,
                )
                self._hold(loop, goes_on)
                if doubt := loop.doubt():
                    self._events.tell("load", doubt)
            except BaseException as error:  # a plug-in may raise anything
                if goes_on():
                    self._failures.append(message_of(error))
            finally:
                self._unsure |= self._loop is not None and not self._loop.rests
                self._phase = LoadPhase.MAY_PRESS if self._unsure else self._rest
                if self._loop is not None:
                    self._last_m = self._loop.touch_m
                self._loop = None
                if self._wanted is wanted:
                    self._wanted = None
        self._events.tell("load", f"the load stage {SAID[self._phase]}")

    def _hold(self, loop: LoadLoop, goes_on: Callable[[], bool]) -> None:
        guarded_s = self._clock()
        with loop:
            self._loop, self._phase = loop, LoadPhase.HOLD
            while goes_on():
                if loop.look().phase is Phase.ENDED:
                    self._failures.append(loop.reason)
                    break
                if self._guard is not None and self._clock() - guarded_s >= GUARDED_S:
                    self._guard.press()
                    guarded_s = self._clock()
            self._phase = LoadPhase.LETTING_GO

    def _look(self) -> None:
        """Say free only of a stage that stands clear now, whoever moved it; it is left there."""
        with self._using:
            if self._stage is not None and self._phase is not LoadPhase.STOPPED:
                clear = self._stands_clear(self._stage)
                self._phase = LoadPhase.FREE if clear else LoadPhase.MAY_PRESS

    def _lift(self) -> None:
        """Try again to let go, until the stage stands clear. One that does not know where it is
        waits for whoever asks for a load.
        """
        section = self._section
        with self._using:
            stage = self._stage
            if section is None or stage is None:
                return
            retracts, mounting = section.when_wrong == "retract", section.mounting()
            try:
                if not self._stands_clear(stage):
                    if not stage.read_status().homed:
                        return
                    lift(stage, mounting, self._guard, retract=retracts)
            except BaseException:  # of a plug-in, too
                return
            if retracts and not self._stands_clear(stage):
                return
            self._phase, self._unsure = self._rest, False
        self._events.tell("load", f"the load stage {SAID[self._phase]}")
