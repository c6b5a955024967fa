"""What a texture asks of a surface: which share of it lies where the surface does not reach."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from haptic_driver.render.texture import Script, Target, Texture
from haptic_driver.signals import Array, FingerState

WEBER = 0.11  # smallest change of friction that is felt, relative; 10.1098/rsif.2017.0641
SCREEN_M = (0.100, 0.060)  # where nobody says which
POINTS = (500, 300)
SCRIPT_TIMES = 2000
SCRIPT_PLACES = 25
FLAG_SHARE = 1e-3  # below, rounding of a range's ends
SAME = 1e-9  # of friction


class Demand(NamedTuple):
    """Friction asked for, against what is reachable; shares of the screen, and of a script's time.

    `share_nothing` asks for nothing. `steps_felt`: how many just noticeable steps lie between
    lowest and highest.
    """

    cof_low: float
    cof_high: float
    share_below: float
    share_above: float
    share_nothing: float
    steps_felt: float
    flags: tuple[str, ...]


def demand(target: Target, reachable_cof: tuple[float, float]) -> Demand:
    """What a texture or script asks for on `SCREEN_M` with a corner at 0, 0, against the lowest and
    highest friction.
    """
    cof = np.asarray(target_values(target, SCREEN_M)).ravel()
    asked = np.isfinite(cof)
    low, high = target.bounds()
    below = float(np.mean(cof[asked] < reachable_cof[0] - SAME)) if asked.any() else 0.0
    above = float(np.mean(cof[asked] > reachable_cof[1] + SAME)) if asked.any() else 0.0
    steps = float(np.log(high / low) / np.log1p(WEBER))
    flags = []
    if below > FLAG_SHARE:
        flags.append("below_reach")
    if above > FLAG_SHARE:
        flags.append("above_reach")
    if not asked.any():
        flags.append("nothing_on_screen")
    if high - low > SAME and steps < 1.0:
        flags.append("too_faint")
    return Demand(low, high, below, above, float(1.0 - asked.mean()), steps, tuple(flags))


def target_values(target: Target, screen_m: tuple[float, float]) -> Array:
    """Friction [y, x] over a screen, or for a script [place, time] over its time at places spread
    over the screen.
    """
    if isinstance(target, Script):
        return _script_values(target, screen_m)
    assert isinstance(target, Texture)
    x_m, y_m = screen_grid(POINTS, screen_m)
    return target.cof_at(x_m[None, :], y_m[:, None])


def screen_grid(
    points: tuple[int, int], screen_m: tuple[float, float] = SCREEN_M
) -> tuple[Array, Array]:
    """So many x and y, spread evenly over a screen: the middles of its cells."""
    x_m, y_m = (s * (np.arange(n) + 0.5) / n for s, n in zip(screen_m, points, strict=True))
    return x_m, y_m


def _script_values(script: Script, screen_m: tuple[float, float]) -> Array:
    times_s = np.linspace(
        script.start_s + script.steps[0].time_s, script.end_s, SCRIPT_TIMES, endpoint=False
    )
    places = np.random.default_rng(1).random((SCRIPT_PLACES, 2)) * screen_m
    return np.array(
        [
            [script.cof_under(FingerState(t, x, y, 0.0, 0.0, 0.0, True)) for t in times_s.tolist()]
            for x, y in places.tolist()
        ]
    )
