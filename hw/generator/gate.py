"""The last gate before the generator's wire: reads what is about to be sent and refuses too much
voltage.

It does not use the driver's own state. It parses the outgoing bytes and keeps, from them alone, an
upper bound of the voltage at the electrode.
"""

from __future__ import annotations

import math
import re
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar

from hw.errors import LimitExceeded
from hw.generator.settings import GeneratorSettings

_ROUNDING = 1.0 + 1e-9  # numbers go out with 12 digits
# Amplitude at + full scale of Modulation In over the amplitude programmed, where nobody has
# measured it.
_WORST_MODULATION = 2.0
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")


@dataclass(frozen=True)
class Bound:
    """What the instrument holds at most; everything is unknown until a command says it.

    `share` is the waveform's peak over its amplitude, 0 for a constant voltage. Levels mean volts
    into an open circuit only once `load_open` and `unit_vpp` are known.
    """

    vpp: float = math.inf
    offset_v: float = math.inf
    share: float = math.inf
    load_open: bool = False
    unit_vpp: bool = False
    modulated: bool = True
    full_depth: bool = False  # the depth of modulation is known to be 100 %

    def peak_v(self, modulation: float) -> float:
        """Highest voltage at the open terminals if the output is on; `modulation` is the highest at
        full depth.
        """
        if self.share == 0.0:
            return abs(self.offset_v)
        envelope = 1.0 if not self.modulated else modulation if self.full_depth else math.inf
        return abs(self.offset_v) + self.vpp * self.share * envelope


class OutputGate(ABC):
    """Lets messages pass that keep the peak at the electrode within the limit, whether the output
    is on or not.

    A subclass reads one dialect, and only what its driver sends of it: whatever it does not know,
    it refuses. Not thread-safe: the caller holds the transport.
    """

    speaker: ClassVar[str]  # the driver, for messages

    def __init__(self, settings: GeneratorSettings) -> None:
        measured = settings.modulation_input
        self._volts_per_volt = settings.volts_per_volt
        self._limit_v = settings.voltage_limit_v
        self._modulation = (
            _WORST_MODULATION if measured is None else measured.amplitude_at_full_scale
        )
        self._bound = Bound()

    def forget(self) -> None:
        """What was sent last may or may not have arrived."""
        self._bound = Bound()

    def check(self, message: bytes) -> None:
        """Take note of a message that is to be sent next; raises LimitExceeded for one that must
        not be sent.
        """
        self._bound = self._after(self._bound, message.decode("latin-1"))

    @abstractmethod
    def _after(self, bound: Bound, message: str) -> Bound:
        """What a message, with its line end, makes of `bound`; raises LimitExceeded."""

    def _checked(self, bound: Bound, command: str) -> Bound:
        peak_v = bound.peak_v(self._modulation) * self._volts_per_volt
        if not peak_v <= self._limit_v * _ROUNDING:
            raise self._refusal(
                command,
                f"would allow {peak_v:.6g} V at the electrode, over the limit of"
                f" {self._limit_v:g} V",
                "lower the voltage",
            )
        return bound

    def _level(self, bound: Bound, text: str, command: str) -> float:
        """The number of a command that sets a level."""
        if not _NUMBER.fullmatch(text):
            raise self._refusal(command, "has no plain number")
        if not (bound.load_open and bound.unit_vpp):
            raise self._refusal(
                command,
                "sets a level while the programmed load and unit are not known to be open, Vpp",
            )
        return float(text)

    def _refusal(
        self, command: str, why: str = "is not a command that it lets pass", hint: str = ""
    ) -> LimitExceeded:
        hint = hint or (
            f"only what `{self.speaker}` sends may pass; "
            "a new command is first made known to its gate"
        )
        return LimitExceeded(
            f"the last gate holds back {command[:60]!r}: it {why}; nothing was sent", hint
        )
