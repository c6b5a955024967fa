"""Another finger, hand or palm touches the screen beside the finger that is measured."""

from __future__ import annotations

from dataclasses import dataclass, replace

from model.effects.base import Effect, log_parameter
from model.touch import Drive


@dataclass(frozen=True)
class SecondTouch(Effect):
    """The current of all touches is that of one times 1 + area_ratio; friction is of one.

    It is of the instrument, not of the touch, so the catalogue does not hold it: no model of a
    finger should.
    """

    name = "second_touch"
    physics = (
        "other fingers or a palm touch too, and their current flows through the same electrode"
    )
    signature = "more current wherever the finger touches, of the same phase; friction as before"
    check = "let one finger touch alone, and measure the current again"
    source = (
        "of 1,054 contact masks of ten people (CapContact, CHI 2021) 95 % have at most 471 mm2 in"
        " all, the largest 684 mm2"
    )

    # From a finger's tip beside the pad to a palm.
    area_ratio: float = log_parameter("1", 1.0, 2.5, (0.05, 10.0), off=0.0)

    def drive(self, drive: Drive) -> Drive:
        return replace(drive, other_touches=drive.other_touches + self.area_ratio)
