"""What was asked of a device and what it got, which is what everything computes with.

A driver reads back whatever its device may coerce. A difference that its own numbers can take in is
taken in; any other is refused.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import NamedTuple

from hw.errors import InstrumentRejected

ROUNDING = 1e-5  # share by which a number read back counts as the one that was asked: whole counts

Value = float | str | bool


class Setting(NamedTuple):
    """One setting of a device, in SI with the unit in its name; `got` is None where it does not
    say.
    """

    name: str
    asked: Value
    got: Value | None

    @property
    def as_asked(self) -> bool | None:
        """Whether it got what was asked; None where it does not say."""
        if self.got is None:
            return None
        if isinstance(self.asked, float) and isinstance(self.got, float):
            return math.isclose(self.asked, self.got, rel_tol=ROUNDING)
        return self.asked == self.got


def refuse_unlike(resource: str, settings: Iterable[Setting], hint: str) -> None:
    """Raise InstrumentRejected for the first setting that its device holds otherwise."""
    for name, asked, got in (setting for setting in settings if setting.as_asked is False):
        raise InstrumentRejected(f"{resource}: {name} {asked} was asked for, it is {got}", hint)
