"""What was asked for when: a target is chosen before the moment for which it is, and friction is felt after it."""

from __future__ import annotations

from math import inf, nan
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
        self.forget()

    def forget(self) -> None:
        """Nothing was asked for."""
        self._moments_s = [-inf] * LENGTH
        self._asked = [NOBODY_KNOWS] * LENGTH
        self._count = 0

    def add(self, moment_s: float, asked: Asked) -> None:
        """One more, for a later moment than all before."""
        place = self._count % LENGTH
        self._moments_s[place] = moment_s
        self._asked[place] = asked
        self._count += 1

    def at(self, moment_s: float) -> Asked:
        """What was asked for a moment, between two ticks in proportion; NaN where nobody knows."""
        first, last = max(self._count - LENGTH, 0), self._count - 1
        oldest_s, newest_s = self._moments_s[first % LENGTH], self._moments_s[last % LENGTH]
        if not oldest_s <= moment_s <= newest_s:
            return NOBODY_KNOWS
        place = max(last - int((newest_s - moment_s) / self._period_s), first)
        while place > first and self._moments_s[place % LENGTH] > moment_s:
            place -= 1
        while place < last and self._moments_s[(place + 1) % LENGTH] <= moment_s:  # ticks were missed
            place += 1
        before, after = place % LENGTH, min(place + 1, last) % LENGTH
        span_s = self._moments_s[after] - self._moments_s[before]
        share = (moment_s - self._moments_s[before]) / span_s if span_s > 0.0 else 0.0
        low, high = self._asked[before], self._asked[after]
        target_cof = low.target_cof + share * (high.target_cof - low.target_cof)
        expected_cof = low.expected_cof + share * (high.expected_cof - low.expected_cof)
        return Asked(target_cof, expected_cof, low.reachable and high.reachable)
