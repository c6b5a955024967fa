"""The bench of a simulated rig with stages: that of a real one, whose time passes in steps."""

from __future__ import annotations

from haptic_driver.lab.measuring.bench import SimulatedBench
from haptic_driver.lab.measuring.plan import Plan, Row, Setting
from haptic_driver.lab.measuring.stage_bench import StageBench, Tell
from haptic_driver.rig.config import RigConfig
from hw.monitor.contract import ElectrodeReading


class SimulatedStageBench(StageBench):
    """Stages, load loop and strokes as on a real rig; rig, finger and scatter are `world`'s."""

    def __init__(
        self, config: RigConfig, plan: Plan, world: SimulatedBench, tell: Tell = lambda what: None
    ) -> None:
        self.world, simulated = world, world.simulated
        devices, clock, sleep = simulated.devices, simulated.clock, simulated.sleep
        super().__init__(config, plan, tell, devices=devices, clock=clock, sleep=sleep)

    def begin_session(self, session: int, time_s: float) -> None:
        self.world.begin_session(session, time_s)
        super().begin_session(session, time_s)

    def begin_row(self, number: int, row: Row) -> None:
        self.world.begin_row(number, row)
        finger = row.setting.finger
        self.world.simulated.asked_n = 0.0 if finger == "none" else row.setting.normal_force_n
        super().begin_row(number, row)

    def step(self, dt_s: float, normal_force_n: float, speed_m_s: float) -> None:
        self.world.simulated.asked_n = normal_force_n
        super().step(dt_s, normal_force_n, speed_m_s)

    def read_electrode(self, setting: Setting) -> ElectrodeReading | None:
        return self.world.read_electrode(setting)
