"""The one finger of a simulated rig, the instruments that act on it, and all that moves it.

Time passes by `World.advance`, in steps as long as whoever simulates likes, or as a clock goes on.
"""

from __future__ import annotations

from collections.abc import Callable

from haptic_driver.rig.parts.load_stages import SimulatedLoadStageConfig
from haptic_driver.simulation.instruments import SimulatedInstruments
from haptic_driver.simulation.pressed_finger import PressedFinger
from hw.stage.simulated import SimulatedLts150

SPEED_STEP_M_S = 1e-3  # the model is asked about whole millimetres per second: answers are kept

Step = Callable[[float, float, float], None]
"""Lets time pass under a load and at a speed: s, N, m/s."""


class World:
    """A stage that has moved slides the finger, and another presses it; until then a hand does.

    `stage_mm`: where the stage begins that carries the finger, None without one. `clock` is that of
    the stages, by default the instruments' own. `step` stands in for the instruments' own step.
    """

    def __init__(
        self,
        instruments: SimulatedInstruments,
        load_stage: SimulatedLoadStageConfig | None = None,
        *,
        stage_mm: float | None = None,
        clock: Callable[[], float] | None = None,
        step: Step | None = None,
    ) -> None:
        self.instruments = instruments
        self.load_n = 0.0
        self._step = step or instruments.step
        self._clock = clock or (lambda: instruments.time_s)
        self.pressed = None if load_stage is None else PressedFinger(load_stage, self._clock)
        self.sliding: SimulatedLts150 | None = None
        if stage_mm is not None:
            self.sliding = SimulatedLts150(self._clock, start_mm=stage_mm)
        self._slid = self._clock(), stage_mm or 0.0
        self._speed_m_s = 0.0

    def advance(self, dt_s: float, hand_n: float, hand_m_s: float = 0.0) -> None:
        """Let `dt_s` pass: stages move the finger, outputs act on it, sensors feel it."""
        plant, pressed = self.instruments.plant, self.pressed
        speed_m_s = self._carried_m_s(hand_m_s)
        self.load_n = hand_n
        if pressed is not None and pressed.stage.has_moved:
            attraction_n = self.instruments.attraction_n()
            self.load_n = pressed.step(dt_s, plant.lateral_force_n, attraction_n)
        self._step(dt_s, self.load_n, speed_m_s)

    def _carried_m_s(self, hand_m_s: float) -> float:
        """By the stage since time passed last, or by the hand."""
        stage, (before_s, before_mm) = self.sliding, self._slid
        if stage is None:
            return hand_m_s
        now_s, here_mm = self._slid = self._clock(), stage.position_mm
        if now_s > before_s:
            speed_m_s = abs(here_mm - before_mm) * 1e-3 / (now_s - before_s)
            self._speed_m_s = SPEED_STEP_M_S * round(speed_m_s / SPEED_STEP_M_S)
        return self._speed_m_s if stage.has_moved else hand_m_s
