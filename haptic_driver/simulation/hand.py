"""What a simulated finger does by itself."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

from haptic_driver.rig.config import RigConfig
from haptic_driver.rig.parts.force_sensors import NetFtForceSensorConfig
from haptic_driver.rig.slide import Slide
from haptic_driver.signals import TICK_S
from hw.force.net_ft_server import NetFtServer
from hw.stage.simulated import SimulatedLts150

CARRIED_N = 0.5  # of a finger that a stage carries
Y_M = 0.030  # on the screen
ON_SCREEN = 0.9  # of its sides: a longer slide is made to fit


class Moment(NamedTuple):
    """Load, speed and place of the finger, N, m/s and m."""

    load_n: float
    speed_m_s: float
    x_m: float
    y_m: float


class Hand:
    """Repeats a slide for ever, or keeps the finger lifted, until the stage moves: then the finger
    rests on the screen and is carried.

    It lifts the finger for the bias of a rig's force box. A simulated rig's takes none.
    """

    def __init__(
        self, config: RigConfig, slide: Slide | None, stage: SimulatedLts150, box: NetFtServer
    ) -> None:
        self._stage, self._box = stage, box
        self._lifts = isinstance(config.force_sensor, NetFtForceSensorConfig)
        self._y_m = min(Y_M, ON_SCREEN * config.screen.height_m)
        self._slide = slide
        if slide is not None:
            longest_m, width_m = abs(slide.position_m).max(), ON_SCREEN * config.screen.width_m
            share = min(1.0, width_m / longest_m) if longest_m > 0.0 else 1.0
            self._slide = replace(slide, position_m=share * slide.position_m)
            self._speed_m_s = self._slide.speed_m_s

    def at(self, time_s: float) -> Moment:
        """What it does so long after it began."""
        slide, carried = self._slide, self._stage.has_moved
        lifted = self._lifts and not self._box.may_be_pressed
        if carried or slide is None:
            load_n = CARRIED_N if carried and not lifted else 0.0
            return Moment(load_n, 0.0, 1e-3 * self._stage.position_mm, self._y_m)
        i = round(time_s / TICK_S) % slide.time_s.size
        load_n = 0.0 if lifted else float(slide.normal_force_n[i])
        return Moment(load_n, float(self._speed_m_s[i]), float(slide.position_m[i]), self._y_m)
