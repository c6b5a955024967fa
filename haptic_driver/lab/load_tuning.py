"""A finger's stiffness from small steps of the load that is held."""

from __future__ import annotations

from dataclasses import replace
from statistics import median, pstdev
from typing import NamedTuple

from haptic_driver.errors import HapticError
from haptic_driver.rig.load_controller import STIFFNESS_AT_N
from haptic_driver.rig.load_loop import LoadLoop

SHARE = 0.1  # of the load, up and down: below what lets go
STEPS = 7
SETTLE_S = 1.0
AVERAGE_S = 1.0  # a whole beat of the pulse


class Tuned(NamedTuple):
    """The stiffness at `STIFFNESS_AT_N`, and its spread over the steps, N/m."""

    stiffness_n_per_m: float
    spread_n_per_m: float


def tune(loop: LoadLoop) -> Tuned:
    """Step the held load up and down and see how far the stage goes for it; leaves it at its
    target.

    Each step is compared with its two neighbours, so that tissue that relaxes counts little.
    HapticError when the stage lets go, and where it does not move with the load.
    """
    settings = loop.settings
    seen: list[tuple[float, float]] = []
    for i in range(STEPS):
        target_n = settings.target_n * (1.0 + (SHARE if i % 2 else -SHARE))
        loop.settings = replace(settings, target_n=target_n)
        loop.hold(SETTLE_S)
        seen.append(loop.average(AVERAGE_S))
    loop.settings = settings
    slopes = [
        (2.0 * here[0] - before[0] - after[0]) / (2.0 * here[1] - before[1] - after[1])
        for before, here, after in zip(seen, seen[1:], seen[2:], strict=False)
    ]
    if min(slopes) <= 0.0:
        said = "the load falls where the stage presses: look at higher_presses"
        raise HapticError("not_tuned", said, "Then tune again")
    scale = (STIFFNESS_AT_N / settings.target_n) ** (1.0 / 3.0)
    return Tuned(scale * median(slopes), scale * pstdev(slopes))
