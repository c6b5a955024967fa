"""What was asked for when: a target is chosen before the moment for which it is, and friction is
felt after it.
"""

from __future__ import annotations

from collections import deque
from math import nan
from typing import NamedTuple

LENGTH = 256  # ticks; more than any latency


class Asked(NamedTuple):
    """A target, the friction that render expected of it, and whether it was within reach."""

    target_cof: float
    expected_cof: float
    reachable: bool


NOBODY_KNOWS = Asked(nan, nan, False)


class AskedFor:
    """Targets of the last ticks, by the moments for which they were."""

    def __init__(self, period_s: float) -> None:
        self._period_s = period_s
        self._kept: deque[tuple[float, Asked]] = deque(maxlen=LENGTH)

    def forget(self) -> None:
        """Nothing was asked for."""
        self._kept.clear()

    def add(self, moment_s: float, asked: Asked) -> None:
        """One more, for a later moment than all before."""
        self._kept.append((moment_s, asked))

    def at(self, moment_s: float) -> Asked:
        """What was asked for a moment, between two ticks in proportion; NaN where nobody knows."""
        kept = self._kept
        if not kept or not kept[0][0] <= moment_s <= kept[-1][0]:
            return NOBODY_KNOWS
        last = len(kept) - 1
        place = max(last - int((kept[last][0] - moment_s) / self._period_s), 0)
        while kept[place][0] > moment_s:
            place -= 1
        while place < last and kept[place + 1][0] <= moment_s:  # ticks were missed
            place += 1
        (before_s, low), (after_s, high) = kept[place], kept[min(place + 1, last)]
        share = (moment_s - before_s) / (after_s - before_s) if after_s > before_s else 0.0
        target_cof = low.target_cof + share * (high.target_cof - low.target_cof)
        expected_cof = low.expected_cof + share * (high.expected_cof - low.expected_cof)
        return Asked(target_cof, expected_cof, low.reachable and high.reachable)
