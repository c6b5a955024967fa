"""What was asked for when: a target is chosen before the moment for which it is, and friction is felt after it."""

from __future__ import annotations

from math import inf, nan

LENGTH = 256  # ticks; more than any latency


class AskedFor:
    """Targets of the last ticks and what was expected of them, by the moments for which they were."""

    def __init__(self, period_s: float) -> None:
        self._period_s = period_s
        self.forget()

    def forget(self) -> None:
        """Nothing was asked for."""
        self._moments_s = [-inf] * LENGTH
        self._targets = [nan] * LENGTH
        self._expected = [nan] * LENGTH
        self._count = 0

    def add(self, moment_s: float, target_cof: float, expected_cof: float) -> None:
        """One more, for a later moment than all before."""
        place = self._count % LENGTH
        self._moments_s[place] = moment_s
        self._targets[place] = target_cof
        self._expected[place] = expected_cof
        self._count += 1

    def at(self, moment_s: float) -> tuple[float, float]:
        """Target and expected friction for a moment, between two ticks in proportion; NaN where nobody knows."""
        first, last = max(self._count - LENGTH, 0), self._count - 1
        oldest_s, newest_s = self._moments_s[first % LENGTH], self._moments_s[last % LENGTH]
        if not oldest_s <= moment_s <= newest_s:
            return nan, nan
        place = max(last - int((newest_s - moment_s) / self._period_s), first)
        while place > first and self._moments_s[place % LENGTH] > moment_s:
            place -= 1
        while place < last and self._moments_s[(place + 1) % LENGTH] <= moment_s:  # ticks were missed
            place += 1
        before, after = place % LENGTH, min(place + 1, last) % LENGTH
        span_s = self._moments_s[after] - self._moments_s[before]
        share = (moment_s - self._moments_s[before]) / span_s if 0.0 < span_s < inf else 0.0
        return _between(self._targets, before, after, share), _between(self._expected, before, after, share)


def _between(values: list[float], before: int, after: int, share: float) -> float:
    return values[before] + share * (values[after] - values[before])
