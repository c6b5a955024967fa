"""How a stage that presses a finger lets go of it: by its own answers, whatever a sensor says."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:  # who reads a rig's file does not wait for devices
    from hw.stage.lts150 import StageStatus


class Movable(Protocol):
    """What of a stage it takes; every method may raise DeviceError."""

    def set_velocity(self, velocity_m_s: float, acceleration_m_s2: float) -> None:
        """For the moves to come."""

    def move_to(self, position_m: float) -> None:
        """Start a move."""

    def stop(self) -> StageStatus:
        """Stop and return the status at rest."""


@dataclass(frozen=True)
class Mounting:
    """How the stage stands to the finger: `towards` is 1 where higher positions press, else -1.

    Letting go goes back by `retract_m` from where the stage is, no further than `clear_m`, the
    position at which the finger is free.
    """

    towards: int
    clear_m: float
    retract_m: float = 5e-3
    retract_m_s: float = 20e-3
    acceleration_m_s2: float = 50e-3

    def depth_m(self, position_m: float) -> float:
        return self.towards * position_m

    def position_m(self, depth_m: float) -> float:
        return self.towards * depth_m


def let_go(stage: Movable, mounting: Mounting, *, retract: bool) -> None:
    """Stop, and begin to go back where that is safe. Raises DeviceError."""
    status = stage.stop()
    if retract:
        back_m = mounting.depth_m(status.position_m) - mounting.retract_m
        stage.set_velocity(mounting.retract_m_s, mounting.acceleration_m_s2)
        stage.move_to(mounting.position_m(max(back_m, mounting.depth_m(mounting.clear_m))))
