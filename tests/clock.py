"""Time that passes only when somebody says so."""

from __future__ import annotations


class ManualClock:
    """What a clock and its `sleep` are to the code under test."""

    def __init__(self, now_s: float = 0.0) -> None:
        self.now_s = now_s

    def __call__(self) -> float:
        return self.now_s

    def sleep(self, duration_s: float) -> None:
        self.now_s += duration_s

    def sleep_until(self, time_s: float) -> None:
        self.now_s = max(self.now_s, time_s)
