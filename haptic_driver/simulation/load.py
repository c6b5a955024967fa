"""Force sensor and load stage of a simulated rig, as `haptic load` uses them."""

from __future__ import annotations

import time
from collections.abc import Callable

from haptic_driver.errors import BadInputError
from haptic_driver.rig.config import RigConfig
from haptic_driver.rig.devices import LoadDevices
from haptic_driver.rig.parts.load_stages import SimulatedLoadStageConfig
from haptic_driver.simulation.rig import SimulatedRig
from haptic_driver.simulation.stages import SimulatedStages
from hw.health import FORCE, watched
from model.touch_model import TouchModel


class SimulatedLoad:
    """`devices`, on a clock of their own: `clock` and `sleep`. The finger rests; nothing is driven.

    `in_real_time`: whoever sleeps also waits. BadInputError for a rig without a load stage.
    """

    def __init__(self, config: RigConfig, model: TouchModel, *, in_real_time: bool) -> None:
        section = config.load_stage
        if not isinstance(section, SimulatedLoadStageConfig):
            raise BadInputError(
                "no_load_stage",
                f"rig {config.name} has no load stage: the load is the finger's own",
                "Take --rig simulated-paper, or add a section [load_stage] to its file",
            )
        self._rig = SimulatedRig(config, model, friction=lambda *condition: 0.0)
        self._wait: Callable[[float], object] = time.sleep if in_real_time else lambda s: None
        stages = SimulatedStages(None, section, self._rig.step)
        self._stages, stage = stages, stages.load_stage
        assert stage is not None  # there is a section
        self.clock = stages.clock
        self.devices = LoadDevices(
            force_sensor=watched(self._rig.force_sensor, "force_sensor", FORCE, self.clock),
            load_stage=stage,
            opening=[self._rig.__enter__, stage.connect],
            closing=[stage.close, self._rig.__exit__],
        )

    def sleep(self, duration_s: float) -> None:
        """Let simulated time pass, and real time too where it is asked for."""
        self._wait(duration_s)
        self._stages.sleep(duration_s)
