"""A simulated LTS150 with faults on demand."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from hw.serving.responder import Disconnect
from hw.stage.apt import Frame, Message, MotionStatus, StatusBit
from hw.stage.simulated import COUNTS_PER_MM, SimulatedLts150, _Speed


@dataclass
class StageFaults:
    """What is wrong with the instrument; change it at any time."""

    silent: bool = False  # commands are carried out, nothing is answered
    hung_up: bool = False  # the USB cable is out; what moves goes on moving
    blocked_at_mm: float | None = (
        None  # the carriage cannot pass: it rests there, with the error bit set
    )
    ignores_profiled_stop: bool = False
    says_moving: bool = False  # a bit of its status stays set
    stands: bool = False  # every order is taken, and the carriage does not move
    noise: bytes = b""  # comes before every answer
    delivered_bytes: float = math.inf  # each answer is cut after so many


@dataclass
class FaultyLts150(SimulatedLts150):
    """The same, with `faults`; raises Disconnect when hung up."""

    faults: StageFaults = field(default_factory=StageFaults)

    def handle(self, data: bytes) -> bytes:
        if self.faults.hung_up:
            raise Disconnect(b"")
        answer = super().handle(data)
        if self.faults.silent or not answer:
            return b""
        whole = self.faults.noise + answer
        return whole[: int(min(len(whole), self.faults.delivered_bytes))]

    def _status(self) -> MotionStatus:
        status = super()._status()
        if not self.faults.says_moving:
            return status
        return status._replace(bits=status.bits | StatusBit(0x10))

    def _move(self, to_mm: float, speed: _Speed, announce: Message) -> None:
        if not self.faults.stands:
            super()._move(to_mm, speed, announce)

    def _stop(self, immediate: bool) -> None:
        if immediate or not self.faults.ignores_profiled_stop:
            super()._stop(immediate)

    def _advance(self) -> list[Frame]:
        motion, blocked_mm = self._motion, self.faults.blocked_at_mm
        if motion is None or blocked_mm is None:
            return super()._advance()
        here_mm = motion.position_mm(self.clock())
        if (motion.start_mm - blocked_mm) * (here_mm - blocked_mm) >= 0.0:  # not past it
            return super()._advance()
        # one count short of it, so that it is still in the way of the next move
        self._motion, self._rest_mm = (
            None,
            blocked_mm - math.copysign(1.0 / COUNTS_PER_MM, motion.way_mm),
        )
        self._set_bits(StatusBit.MOTION_ERROR, True)
        return []
