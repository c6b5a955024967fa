"""The bench of a simulated rig with stages: that of a real one, whose time passes in steps."""

from __future__ import annotations

from haptic_driver.lab.measuring.bench import SimulatedBench
from haptic_driver.lab.measuring.plan import Plan, Row, Setting
from haptic_driver.lab.measuring.stage_bench import StageBench, Tell
from haptic_driver.rig.config import RigConfig
from haptic_driver.rig.devices import Devices
from haptic_driver.rig.parts.load_stages import SimulatedLoadStageConfig
from haptic_driver.rig.parts.stages import Lts150StageConfig
from haptic_driver.simulation.stages import SimulatedStages
from hw.health import FORCE, watched
from hw.monitor.contract import ElectrodeReading


class SimulatedStageBench(StageBench):
    """Stages, load loop and strokes as on a real rig; rig, finger and scatter are `world`'s."""

    def __init__(
        self,
        config: RigConfig,
        plan: Plan,
        world: SimulatedBench,
        tell: Tell = lambda what: None,
    ) -> None:
        self.world = world
        pressing, instruments = config.load_stage, world.simulated.instruments
        self.stages = SimulatedStages(
            config.stage if isinstance(config.stage, Lts150StageConfig) else None,
            pressing if isinstance(pressing, SimulatedLoadStageConfig) else None,
            world.step,
            lambda: (instruments.plant.lateral_force_n, instruments.attraction_n()),
        )
        super().__init__(
            config,
            plan,
            tell,
            devices=_devices(world, self.stages),
            clock=lambda: world.time_s,
            sleep=self.stages.sleep,
        )

    def begin_session(self, session: int, time_s: float) -> None:
        self.world.begin_session(session, time_s)
        super().begin_session(session, time_s)

    def begin_row(self, number: int, row: Row) -> None:
        self.world.begin_row(number, row)
        finger = row.setting.finger
        self.stages.asked_n = 0.0 if finger == "none" else row.setting.normal_force_n
        super().begin_row(number, row)

    def step(self, dt_s: float, normal_force_n: float, speed_m_s: float) -> None:
        self.stages.asked_n = normal_force_n
        super().step(dt_s, normal_force_n, speed_m_s)

    def read_electrode(self, setting: Setting) -> ElectrodeReading | None:
        return self.world.read_electrode(setting)


def _devices(world: SimulatedBench, stages: SimulatedStages) -> Devices:
    drivers = [driver for driver in (stages.stage, stages.load_stage) if driver is not None]
    return Devices(
        rig=world.rig,
        force_sensor=watched(world.simulated.force_sensor, "force_sensor", FORCE, stages.clock),
        tracker=None,
        stage=stages.stage,
        analog_output=None,
        watchdog=None,
        opening=[world.__enter__, *(driver.connect for driver in drivers)],
        closing=[*(driver.close for driver in drivers), lambda: world.__exit__(None, None, None)],
        camera=world.camera,
        load_stage=stages.load_stage,
    )
