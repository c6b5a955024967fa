"""What a finger really felt in an interval, by the daemon's samples, and whether that was what the trial asked for."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from haptic_driver.experiments.psychophysics.description import Delivery
from haptic_driver.rig.slide import average
from haptic_driver.signals import SLIDING_M_S, WITHIN, Array, Mask

STROKE_M = 0.003  # a finger that goes this far one way makes a stroke


class Felt(NamedTuple):
    """Means over the time that the finger slid; NaN where it did not.

    `asked_cof`, `reachable_cof` (what the rig could expect to do of it) and `felt_cof` (by the force sensor), `error`
    and `within_5_percent` of what was felt against what was asked.
    """

    asked_cof: float = np.nan
    reachable_cof: float = np.nan
    felt_cof: float = np.nan
    error: float = np.nan
    within_5_percent: float = np.nan
    sliding_s: float = 0.0
    strokes: float = 0.0
    speed_m_s: float = np.nan
    normal_force_n: float = np.nan


def felt(samples: NDArray[np.void], where: Mask | None = None, settle_s: float = 0.0) -> Felt:
    """What samples of one interval, of dtype SAMPLE [n], say; of those at `where` alone, if that is given.

    Friction is judged over moving averages, as that of a rendered slide is, from `settle_s` after the first sample on;
    so is what was asked.
    """
    if not samples.size:
        return Felt()
    time_s, normal = samples["time_s"], samples["normal_force_n"]
    sliding = (
        (samples["in_contact"] == 1) & (samples["speed_m_s"] >= SLIDING_M_S) & np.isfinite(samples["measured_cof"])
    )
    judged = sliding & np.isfinite(samples["target_cof"]) & (time_s >= time_s[0] + settle_s)
    if where is not None:
        judged &= where
    if not judged.any():
        return Felt(strokes=strokes(samples))
    lateral, pressed, target = (  # averaged apart, as a texture is felt over a window and noise over noise has a bias
        average(np.where(judged, values, 0.0))[judged]
        for values in (np.abs(samples["lateral_force_n"]), normal, samples["target_cof"])
    )
    measured, asked = lateral / pressed, target / average(judged)[judged]
    error = measured / asked - 1.0
    tick_s = float(np.median(np.diff(time_s))) if time_s.size > 1 else 0.0
    return Felt(
        asked_cof=float(asked.mean()),
        reachable_cof=float(samples["expected_cof"][judged].mean()),
        felt_cof=float(measured.mean()),
        error=float(error.mean()),
        within_5_percent=float(np.mean(np.abs(error) <= WITHIN)),
        sliding_s=tick_s * int(judged.sum()),
        strokes=strokes(samples),
        speed_m_s=float(samples["speed_m_s"][judged].mean()),
        normal_force_n=float(normal[judged].mean()),
    )


def why_not_delivered(intervals: list[Felt], settings: Delivery) -> str:
    """Why a trial cannot be judged, of its first interval for which that is so; empty when it was delivered."""
    for number, one in enumerate(intervals, start=1):
        if one.sliding_s < max(settings.least_sliding_s, 1e-9):
            return f"interval {number}: the finger slid for {one.sliding_s:.2g} s"
        if abs(one.reachable_cof / one.asked_cof - 1.0) > WITHIN:
            return f"interval {number}: friction {one.asked_cof:.3g} is out of reach, {one.reachable_cof:.3g} is not"
        if one.within_5_percent < settings.least_share:
            return f"interval {number}: within 5 % for {one.within_5_percent:.0%} of the time"
    return ""


def strokes(samples: NDArray[np.void]) -> int:
    """How often the finger went more than 3 mm one way, along the axis on which it moves more."""
    touching = samples[samples["in_contact"] == 1]
    if touching.size < 2:
        return 0
    places: list[Array] = [touching["position_x_m"], touching["position_y_m"]]
    along = max(places, key=lambda x: float(np.ptp(x)))
    gone = np.flatnonzero(np.diff(touching["tick"].astype(np.int64)) > 1) + 1  # lifted meanwhile
    return sum(_turns(part) for part in np.split(along, gone))


def _turns(position_m: Array) -> int:
    """Strokes of one touch: begun anew where the finger has come back by `STROKE_M` from its furthest point."""
    low = high = float(position_m[0])
    direction, count = 0, 0
    for x in position_m[::5]:
        low, high = min(low, float(x)), max(high, float(x))
        if direction <= 0 and x - low >= STROKE_M:
            direction, count, high = 1, count + 1, float(x)
        elif direction >= 0 and high - x >= STROKE_M:
            direction, count, low = -1, count + 1, float(x)
    return count
