"""The clock of everything that is recorded, CLOCK_MONOTONIC, beside wall time and the clock of
LSL.
"""

from __future__ import annotations

import sys
import time
from typing import Any

from haptic_driver.config import Checked


class ClockOffsets(Checked):
    """What to add to a time of CLOCK_MONOTONIC, s: for wall time (seconds of UTC since 1970), and
    for LSL's clock.

    `lsl_offset_s` is None where this process has no LSL.
    """

    wall_offset_s: float
    lsl_offset_s: float | None


def clock_offsets() -> ClockOffsets:
    """As they are now. LSL is not loaded for it: that would keep the set-point pump waiting."""
    lsl = sys.modules.get("pylsl")
    return ClockOffsets(
        wall_offset_s=time.time() - time.monotonic(),
        lsl_offset_s=None if lsl is None else lsl_offset_s(lsl),
    )


def lsl_offset_s(lsl: Any) -> float:
    """LSL's clock less CLOCK_MONOTONIC, by the module `pylsl`."""
    return float(lsl.local_clock()) - time.monotonic()
