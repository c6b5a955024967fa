"""Simulated stages in a rig's simulated time: what slides the finger, and what presses it.

Both are LTS150s behind their own drivers. Time passes as their wires answer and as whoever waits
sleeps; the finger's body gives the load.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from haptic_driver.rig.parts.load_stages import SimulatedLoadStageConfig, lts150_settings
from haptic_driver.rig.parts.stages import Lts150StageConfig
from haptic_driver.simulation.pressed_finger import PressedFinger
from hw.serving.memory import MemoryTransport
from hw.stage.lts150 import Lts150, StageSettings
from hw.stage.simulated import SimulatedLts150

STEP_S = 1e-3  # in which a pressed finger lives
FREE_STEP_S = 5e-3  # and one in the air
NEAR_M = 0.5e-3  # as near as this it may touch within a step
BYTE_S = 10.0 / 115_200.0
REPLY_S = 2e-3  # which a USB interface with the shortest latency adds to an answer
SPEED_STEP_M_S = 1e-3  # the model is asked about whole millimetres per second: answers are kept


class SimulatedStages:
    """The stages of a simulated rig's file, either of which may be missing, with their drivers.

    `pass_time(dt_s, load_n, speed_m_s)` is called for every step of time, `touch_n` gives friction
    and attraction of the touch. Without a load stage the finger presses with `asked_n`, as a person
    does who is asked to.
    """

    def __init__(
        self,
        stage: Lts150StageConfig | None,
        load_stage: SimulatedLoadStageConfig | None,
        pass_time: Callable[[float, float, float], None],
        touch_n: Callable[[], tuple[float, float]] = lambda: (0.0, 0.0),
    ) -> None:
        self.now_s = 0.0
        self.asked_n = 0.0
        self.load_n = 0.0
        self._pass_time, self._touch_n = pass_time, touch_n
        self.sliding: SimulatedLts150 | None = None
        self.pressed: PressedFinger | None = None
        self.stage: Lts150 | None = None
        self.load_stage: Lts150 | None = None
        if stage is not None:
            self.sliding = SimulatedLts150(self.clock)
            self.stage = self._driver(self.sliding, stage.settings())
        if load_stage is not None:
            self.pressed = PressedFinger(load_stage, self.clock)
            self.load_stage = self._driver(self.pressed.stage, lts150_settings(load_stage))
        self._slid_m = self._position_m()

    def clock(self) -> float:
        """Simulated time."""
        return self.now_s

    def sleep(self, duration_s: float) -> None:
        """Let time pass: the finger slides and is pressed as the stages move."""
        end_s = self.now_s + duration_s
        while self.now_s < end_s - 1e-12:
            depth_m = self._depth_m()
            step_s = STEP_S if depth_m > -NEAR_M else FREE_STEP_S
            self._live(min(step_s, end_s - self.now_s))

    def _live(self, dt_s: float) -> None:
        self.now_s += dt_s
        before_m, self._slid_m = self._slid_m, self._position_m()
        speed_m_s = abs(self._slid_m - before_m) / dt_s
        speed_m_s = SPEED_STEP_M_S * round(speed_m_s / SPEED_STEP_M_S)
        if self.pressed is None:
            self.load_n = self.asked_n
        else:
            self.load_n = self.pressed.step(dt_s, *self._touch_n())
        self._pass_time(dt_s, self.load_n, speed_m_s)

    def _depth_m(self) -> float:
        if self.pressed is None:
            return 0.0 if self.asked_n > 0.0 else -math.inf
        return self.pressed.depth_m

    def _position_m(self) -> float:
        return 0.0 if self.sliding is None else 1e-3 * self.sliding.position_mm

    def _driver(self, instrument: SimulatedLts150, settings: StageSettings) -> Lts150:
        wire = MemoryTransport(_Wire(instrument, self.sleep), clock=self.clock)
        return Lts150(wire, settings, clock=self.clock, sleep=self.sleep)


class _Wire:
    """An instrument whose answers take the time of their bytes and of the interface."""

    def __init__(self, instrument: SimulatedLts150, sleep: Callable[[float], None]) -> None:
        self._instrument, self._sleep = instrument, sleep

    def handle(self, data: bytes) -> bytes:
        answer = self._instrument.handle(data)
        self._sleep(BYTE_S * (len(data) + len(answer)) + (REPLY_S if answer else 0.0))
        return answer
