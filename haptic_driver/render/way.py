"""Way stage: the place whose friction is rendered, for waves that are finer than places are known.

A panel of 50 reports per second tells a finger's place to a millimetre or so, and each report
corrects it by a jump. Waves of two millimetres then have no length of their own: their phase jumps
with every report. Here the rendered place goes along the finger's reports at their own pace, one
report late, without a jump. So waves have the right length, and ridges lie behind where they were
drawn.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from haptic_driver.signals import FingerSample, FingerState


class Way(NamedTuple):
    """What the stage remembers: from one place to that of the last report, in the time that lay
    between reports.
    """

    reported_s: float
    began_s: float
    takes_s: float
    from_x_m: float
    from_y_m: float
    to_x_m: float
    to_y_m: float

    def share(self, now_s: float) -> float:
        """How much of it lies behind: 1 at its end, where the next report is waited for."""
        gone_s = now_s - self.began_s
        return gone_s / self.takes_s if gone_s < self.takes_s else 1.0

    def at(self, share: float) -> tuple[float, float]:
        """The place after that share."""
        x_m = self.from_x_m + share * (self.to_x_m - self.from_x_m)
        return x_m, self.from_y_m + share * (self.to_y_m - self.from_y_m)


def follow(
    way: Way | None, sample: FingerSample, felt: FingerState, longest_s: float
) -> tuple[Way | None, FingerState]:
    """The way, none without contact, and the finger with its place and velocity on it.

    A way takes at most `longest_s`.
    """
    if not felt.in_contact:
        return None, felt
    time_s, x_m, y_m = sample.time_s, sample.position_x_m, sample.position_y_m
    now_s = felt.time_s
    if way is None:
        way = Way(time_s, now_s, 0.0, x_m, y_m, x_m, y_m)
    elif time_s > way.reported_s:
        takes_s = min(time_s - way.reported_s, longest_s)
        way = Way(time_s, now_s, takes_s, *way.at(way.share(now_s)), x_m, y_m)
    share = way.share(now_s)
    x_m, y_m = way.at(share)
    per_s = 1.0 / way.takes_s if share < 1.0 else 0.0
    vx_m_s, vy_m_s = per_s * (way.to_x_m - way.from_x_m), per_s * (way.to_y_m - way.from_y_m)
    placed = felt._replace(
        position_x_m=x_m,
        position_y_m=y_m,
        velocity_x_m_s=vx_m_s,
        velocity_y_m_s=vy_m_s,
        met_m_s=math.hypot(felt.velocity_x_m_s, felt.velocity_y_m_s),
    )
    return way, placed
