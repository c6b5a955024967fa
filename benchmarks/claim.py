"""One claim: what was measured against what was promised."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from typing import NamedTuple


class Claim(NamedTuple):
    what: str
    measured: str
    wanted: str
    holds: bool


def seconds(function: Callable[[], object], repeats: int = 5) -> float:
    """Median time of one call, after one call that is not counted."""
    function()
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        function()
        times.append(time.perf_counter() - start)
    return statistics.median(times)
