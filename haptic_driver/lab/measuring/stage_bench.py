"""A real rig on which a stage slides the screen under a finger, or the finger over the screen: one
stroke per row.

The stage sets the speed. A load stage holds each row's load; without one the load is the finger's
own, by hand or by weights, and is waited for. What it was during a row is measured. Times are real,
or those of whoever gives clock and devices.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from types import SimpleNamespace
from typing import Self

from haptic_driver.errors import HapticError
from haptic_driver.lab.measuring.bench import AwaitStart, Place, at_once
from haptic_driver.lab.measuring.plan import Plan, Row, Setting
from haptic_driver.lab.measuring.stroke import SPARE_S, StageMove, stage_of, stroke
from haptic_driver.rig.config import RigConfig
from haptic_driver.rig.devices import Devices, connect_devices
from haptic_driver.rig.load_loop import LoadLoop, LoadSensor, make_clear
from haptic_driver.rig.parts.analog_outputs import NoAnalogOutput
from haptic_driver.rig.parts.load_stages import LoadStageSection
from haptic_driver.rig.rig import Rig
from hw.camera.contract import Camera
from hw.force.sensor import ForceReading
from hw.health import FORCE, with_health
from hw.monitor.contract import ElectrodeReading
from hw.stage.lts150 import Lts150, StageStatus

LOAD_WAIT_S = 60.0  # for a person to bring the load, or to lift the finger
LOAD_STEADY_S = 0.3  # over which a load is averaged before it is believed
LOAD_POLL_S = 0.02
PLACE_S = 0.05  # between looks at a sliding stage, whose answer takes longer than a force's
HOMING_S = 60.0  # [unverified] of the slowest homing
SPEED_TOLERANCE = 0.05  # by which the stage's own speed may differ from what was set

Tell = Callable[[str], None]


def without_envelope(config: RigConfig) -> RigConfig:
    """The rig with its amplitudes over SCPI: a row needs one amplitude, and no envelope."""
    return config.model_copy(update={"analog_output": NoAnalogOutput()})


class StageBench:
    """The devices of a rig's file as a bench; see `Bench`. `tell` is called with what the person
    has to do now. `devices` stand in for those of the file, `clock` and `sleep` for real time.

    Entering opens the devices, which takes the force sensor's bias: nothing may touch the screen.
    It homes the stage if needed. Leaving switches off and stops the stage. Raises HapticError and
    DeviceError.
    """

    def __init__(
        self,
        config: RigConfig,
        plan: Plan,
        tell: Tell = lambda what: None,
        *,
        devices: Devices | None = None,
        clock: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], object] = time.sleep,
    ) -> None:
        self._config = config
        self._stage_config = stage_of(config)
        self._plan = plan
        self._tell = tell
        self._devices = devices or connect_devices(without_envelope(config), load_stage=True)
        self._clock, self._sleep = clock, sleep
        self._sensor_zero_s = 0.0  # on the force sensor's clock
        self.await_start: AwaitStart = at_once
        self._sessions = 0
        self._load: LoadLoop | None = None  # while a load stage presses
        self._last_m: float | None = None  # where it last felt the finger
        self._pressing = ExitStack()
        # its speed, and the stage's status when it had been reached; None while the finger does not
        # slide
        self._stroke: tuple[float, StageStatus] | None = None
        self._path: StageMove | None = None  # from its start until the finger is lifted
        self.places: list[Place] = []

    @property
    def rig(self) -> Rig:
        return self._devices.rig

    @property
    def camera(self) -> Camera | None:
        return self._devices.camera

    @property
    def time_s(self) -> float:
        return self._clock()

    def begin_session(self, session: int, time_s: float) -> None:
        """See `Bench`. Another session is another placing of the finger: it has to be lifted
        first.
        """
        self._sessions += 1
        self._last_m = None
        if self._sessions > 1:
            lifted_n = self._config.finger.contact_off_n
            self._await_load(
                f"session {session}: lift the finger", lambda load_n: load_n < lifted_n
            )
        self._sensor_zero_s = self.rig.read_force().time_s - time_s

    def begin_row(self, number: int, row: Row) -> None:
        """See `Bench`. To where the stroke begins, until the load is there, and up to speed."""
        stage, wanted_n = self._stage, row.setting.normal_force_n
        if self._path is not None:  # an attempt that was cut short left it sliding
            self._rest()
        self._stroke = self._path = None
        self.places = []
        self._lift()
        if row.setting.finger == "none":
            lifted_n = self._config.finger.contact_off_n
            self._await_load(
                f"row {number + 1}: take the finger off", lambda load_n: load_n < lifted_n
            )
            return
        tolerance_n = self._plan.load_tolerance * wanted_n
        pressing = f"row {number + 1}: press with {wanted_n:g} N"
        if row.setting.finger == "resting":
            self._press(f"{pressing}, still", wanted_n, tolerance_n)
            return
        path = stroke(row.setting, self._plan, self._config)
        stage.set_velocity(self._stage_config.velocity_m_s, self._stage_config.acceleration_m_s2)
        stage.move_to(path.start_m)
        stage.wait(self._move_s(stage, path.start_m))
        self._press(pressing, wanted_n, tolerance_n)
        stage.set_velocity(path.speed_m_s, self._stage_config.acceleration_m_s2)
        self.rig.watch(self._clock())
        self.await_start(f"row {number + 1}", self._wait)
        self._tell(f"row {number + 1}: measuring, hold {wanted_n:g} N")
        stage.move_to(path.end_m)
        self._path = path
        self._place()

    @property
    def run_up_s(self) -> float:
        return 0.0 if self._path is None else self._path.accelerate_s

    def up_to_speed(self) -> None:
        """See `Bench`."""
        if self._path is None:
            return
        began = self._place()
        self._stroke = self._path.speed_m_s, began
        if not began.moving:
            raise HapticError(
                "stage_rests",
                "the stage was ordered to move and rests",
                "Free the stage; is it enabled?",
            )

    def step(self, dt_s: float, normal_force_n: float, speed_m_s: float) -> None:
        """See `Bench`. Time passes by itself; without a load the stage rests and the finger may
        lift.
        """
        if normal_force_n == 0.0:
            self._rest()
            self._path = None
            self._lift()
        self._wait(dt_s)
        if self._path is not None and self.time_s - self.places[-1].time_s >= PLACE_S:
            self._place()

    def _rest(self) -> None:
        if self._stage.read_status().moving:
            self._stage.stop()

    def read_force(self) -> ForceReading:
        reading = self.rig.read_force()
        return self._on_session_clock(reading)

    def forces(self, newest: ForceReading) -> Sequence[ForceReading]:
        """See `Bench`."""
        return [self._on_session_clock(told) for told in self.rig.take_forces()] or [newest]

    def read_electrode(self, setting: Setting) -> ElectrodeReading | None:
        i = self._config.electrode_monitor(setting.frequency_hz, setting.sweep)
        if i is None:
            return None
        monitor = self._devices.electrode_monitors[i]
        return monitor.read(
            setting.frequency_hz, setting.voltage_v, lambda: self.rig.hold(self.time_s)
        )

    def end_row(self) -> None:
        """See `Bench`. HapticError when the stage did not slide at the row's speed all the time."""
        if self._stroke is None:
            return
        (wanted_m_s, began), ended = self._stroke, self._place()
        if not ended.moving:
            said = (
                f"the stage came to rest at {1e3 * ended.position_m:.1f} mm before the row was over"
            )
            hint = "The rig answers too slowly for this plan: is the computer busy? Then --resume"
            raise HapticError("stroke_ended", said, hint)
        speed_m_s = (ended.position_m - began.position_m) / (ended.time_s - began.time_s)
        if abs(speed_m_s - wanted_m_s) > SPEED_TOLERANCE * wanted_m_s:
            said = f"the stage slid at {1e3 * speed_m_s:.2f} mm/s, not {1e3 * wanted_m_s:.2f} mm/s"
            hint = "Free the stage, or look at its scale in the rig's file; then --resume"
            raise HapticError("stage_slipped", said, hint)

    def __enter__(self) -> Self:
        """Open the devices and home the stage."""
        self._tell("taking the force sensor's bias: touch nothing")
        self._devices.open()
        try:
            status = self._stage.read_status()
            if self._devices.load_stage is not None:
                self._tell("moving the load stage to where the finger is free: keep clear")
                make_clear(self._devices.load_stage, self._load_section.mounting())
            if not status.homed:
                self._tell("homing the stage: keep clear")
                self._stage.home()
                self._stage.wait(HOMING_S)
        except BaseException:
            self._devices.close()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        """Switch off, lift the finger, stop the stages, hang up."""
        try:
            if self._load is not None:
                self.rig.off()
                self._lift()
        finally:
            self._devices.close()

    @property
    def _stage(self) -> Lts150:
        stage = self._devices.stage
        assert stage is not None  # the constructor has looked
        return stage

    @property
    def _load_section(self) -> LoadStageSection:
        section = self._config.load_stage
        assert isinstance(section, LoadStageSection)  # no other kind makes a stage
        return section

    def _on_session_clock(self, reading: ForceReading) -> ForceReading:
        return reading._replace(time_s=reading.time_s - self._sensor_zero_s)

    def _place(self) -> StageStatus:
        """Where the stage is now, which is kept."""
        status = self._stage.read_status()
        self.places.append(Place(status.time_s, status.position_m))
        return status

    def _press(self, what: str, wanted_n: float, tolerance_n: float) -> None:
        """Until the load is there, brought by the load stage or by whoever presses."""
        stage = self._devices.load_stage
        if stage is None:
            self._await_load(what, lambda load_n: abs(load_n - wanted_n) <= tolerance_n)
            return
        section = self._load_section
        self._tell(what)
        settings = section.loop(wanted_n)
        load = LoadLoop(
            stage,
            self._sensor(),
            settings,
            section.mounting(),
            clock=self._clock,
            sleep=self._sleep,
            guard=self._devices.watchdog,
            last_m=self._last_m,
        )
        self._load = self._pressing.enter_context(load)
        self._load.settle(LOAD_WAIT_S)

    def _sensor(self) -> LoadSensor:
        """The force sensor as the rig reads it, which switches off where it fails."""
        read = SimpleNamespace(read=self.rig.read_force)
        sensor: LoadSensor = with_health(read, "force_sensor", FORCE, self._clock)
        return sensor

    def _lift(self) -> None:
        """Have the load stage let go, and forget its loop."""
        if self._load is not None:
            self._last_m = self._load.touch_m
        self._load = None
        self._pressing.close()

    def _wait(self, duration_s: float) -> None:
        """Time passes; a load stage holds meanwhile."""
        if self._load is None:
            self._sleep(duration_s)
        else:
            self._load.hold(duration_s)
        self.rig.watch(self._clock())

    def _move_s(self, stage: Lts150, position_m: float) -> float:
        """What a move from here may take at most."""
        away_m = abs(position_m - stage.read_status().position_m)
        speed_m_s, acceleration_m_s2 = (
            self._stage_config.velocity_m_s,
            self._stage_config.acceleration_m_s2,
        )
        return (
            2.0 * (away_m / speed_m_s + speed_m_s / acceleration_m_s2)
            + SPARE_S
            + stage.settings.reply_timeout_s
        )

    def _await_load(self, what: str, wanted: Callable[[float], bool]) -> None:
        """Until the load's mean over `LOAD_STEADY_S` is as wanted; HapticError when it is not in
        time.
        """
        began_s = self._clock()
        recent: deque[tuple[float, float]] = deque()
        while True:
            now_s, load_n = self._clock(), self.rig.read_force().normal_force_n
            recent.append((now_s, load_n))
            while now_s - recent[0][0] > LOAD_STEADY_S:
                recent.popleft()
            mean_n = sum(load for _, load in recent) / len(recent)
            if now_s - began_s >= LOAD_STEADY_S and wanted(mean_n):
                return
            if now_s - began_s > LOAD_WAIT_S:
                hint = "Press as asked, or look at the force sensor's axes and bias; then --resume"
                raise HapticError(
                    "load_missed",
                    f"{what}: the load is {mean_n:.2f} N after {LOAD_WAIT_S:g} s",
                    hint,
                )
            self._tell(f"{what}, now {mean_n:.2f} N")
            self._sleep(LOAD_POLL_S)
