"""What the compiled stages know of a policy."""

from __future__ import annotations

from math import nan
from typing import NamedTuple

from haptic_driver.signals import Array


class Choice(NamedTuple):
    """How the carrier is chosen among the frequencies of a surface.

    Of the frequencies that reach the target, those of the least `rank` [f] remain; an infinite
    rank is never taken. Of these the one of the least cost is taken, or without costs the one with
    most authority: the highest friction within the limits. Where none reaches the target,
    authority alone decides.

    The cost is `cost_per_v` times peak volts plus `cost_per_a` times A rms into the finger. Costs
    below 1 are not worth a change of the carrier. `fixed_hz`: the only carrier, NaN for a choice.
    """

    rank: Array
    cost_per_v: float = 0.0
    cost_per_a: float = 0.0
    fixed_hz: float = nan
