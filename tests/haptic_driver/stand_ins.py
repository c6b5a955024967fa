"""Devices and surroundings that more than one test file puts in the place of real ones."""

from __future__ import annotations

import random
import threading
from contextlib import contextmanager

import pytest

from haptic_driver.simulation.served import ServedRig
from haptic_driver.simulation.twin import LOAD_STAGE, as_real
from hw.errors import DeviceTimeout
from hw.force.sensor import ForceReading
from hw.safety import interlock, simulated_interlock
from hw.safety.interlock import HeartbeatInterlock

STEP_S = 0.002
PATIENCE_S = 10.0


class Heard:
    """Keeps every message that reaches an instrument."""

    def __init__(self, core):
        self.core = core
        self.messages = []

    def handle(self, data):
        self.messages.append(data.decode())
        return self.core.handle(data)

    def take(self):
        taken, self.messages = self.messages, []
        return taken


class BreakableSensor:
    """A force sensor that can be broken."""

    broken = False

    def read(self):
        if self.broken:
            raise DeviceTimeout("sensor did not answer", "check its cable")
        return ForceReading(0.0, 0.5, 0.3, False)


@contextmanager
def living_rig(rig_config, touch):
    """Instruments served over their own wires, in a world whose time passes.

    The interlock box and its driver have the patience of a busy machine; `tests/hw/safety` has
    their times.
    """
    with pytest.MonkeyPatch.context() as patch, ServedRig(as_real(rig_config), touch) as rig:
        patch.setattr(simulated_interlock, "SILENCE_S", PATIENCE_S)
        patch.setattr(interlock, "HeartbeatInterlock", _patient_box)
        ended = threading.Event()

        def pass_time():
            while not ended.wait(STEP_S):
                rig.advance(STEP_S)

        world = threading.Thread(target=pass_time)
        world.start()
        try:
            yield rig
        finally:
            ended.set()
            world.join()


def with_load_stage(config, endpoints):
    """A real rig, and the load stage that is served at `endpoints`."""
    return config.model_copy(update={"load_stage": LOAD_STAGE.served_at(endpoints["load_stage"])})


def _patient_box(transport, *, reply_timeout_s):
    return HeartbeatInterlock(transport, reply_timeout_s=max(reply_timeout_s, PATIENCE_S))


class PlantSensor:
    """A force sensor on a finger's plant, with as much noise as a real one."""

    def __init__(self, plant, noise_n=0.003):
        self.plant = plant
        self.noise_n = noise_n
        self.random = random.Random(1)

    def read(self):
        normal_n, lateral_n = (
            force_n + self.random.gauss(0.0, self.noise_n)
            for force_n in (self.plant.normal_force_n, self.plant.lateral_force_n)
        )
        return ForceReading(self.plant.time_s, normal_n, lateral_n, False)
