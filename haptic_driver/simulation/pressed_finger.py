"""A simulated load stage, and the body of the finger that it presses."""

from __future__ import annotations

from collections.abc import Callable

from haptic_driver.rig.parts.load_stages import SimulatedLoadStageConfig
from hw.finger.body import FingerBody, PowerLaw
from hw.stage.simulated import SimulatedLts150

SERIAL_NUMBER = 45_000_002


class PressedFinger:
    """A finger whose load follows from where the stage is; `stage` answers on any wire.

    `thrust_m` is by how much the finger has come to meet the stage.
    """

    def __init__(self, section: SimulatedLoadStageConfig, clock: Callable[[], float]) -> None:
        start_mm = 1e3 * section.clear_m
        self.stage = SimulatedLts150(clock, start_mm=start_mm, serial_number=SERIAL_NUMBER)
        soft = PowerLaw()
        self.body = FingerBody(lambda depth_m: section.stiffness_factor * soft(depth_m))
        self.thrust_m = 0.0
        self._face_m, self._mounting = section.face_m, section.mounting()

    @property
    def depth_m(self) -> float:
        """How far the bone is beyond where the skin first touched; negative in the air."""
        away_m = 1e-3 * self.stage.position_mm - self._face_m
        return self._mounting.depth_m(away_m) + self.thrust_m

    def step(self, dt_s: float, friction_n: float, attraction_n: float) -> float:
        """Let `dt_s` pass under these forces of the touch; the load, N."""
        return self.body.step(dt_s, self.depth_m, attraction_n=attraction_n, friction_n=friction_n)
