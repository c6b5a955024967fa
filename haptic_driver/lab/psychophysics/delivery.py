"""What a finger really felt in an interval, and whether that was what the trial asked for."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from haptic_driver.fidelity.edge import EDGE_V
from haptic_driver.fidelity.measure import errors_of
from haptic_driver.fidelity.samples import strokes_of, tick_s
from haptic_driver.fidelity.sliding import AFTER_TOUCH_S, gaps, since_touch_s, slides, sliding
from haptic_driver.lab.psychophysics.description import Delivery
from haptic_driver.signals import WITHIN, Array, Mask

STROKE_M = 0.003  # a finger that goes this far one way makes a stroke


class Delivered(NamedTuple):
    """What the measure of fidelity says of an interval, by felt against asked friction.

    Means and shares are over the time that the finger slid, NaN where it did not; all of that time
    counts, within reach or not. `error` is felt over asked friction, less 1. `reachable_cof` is
    what the rig expected to do of the target, `reachable_share` how long that was within reach.
    """

    asked_cof: float = np.nan
    reachable_cof: float = np.nan
    felt_cof: float = np.nan
    error: float = np.nan
    within_5_percent: float = np.nan
    reachable_share: float = np.nan
    sliding_s: float = 0.0
    strokes: float = 0.0
    speed_m_s: float = np.nan
    normal_force_n: float = np.nan


def felt(samples: NDArray[np.void], where: Mask | None = None, settle_s: float = 0.0) -> Delivered:
    """What samples of one interval, of dtype SAMPLE [n], say; of those at `where` alone, if given.

    They are judged from `settle_s` after the first on, and from 0.1 s after each touch on.
    """
    if not samples.size:
        return Delivered()
    judged = samples["time_s"] >= samples["time_s"][0] + settle_s
    judged &= since_touch_s(samples) >= AFTER_TOUCH_S
    if where is not None:
        judged &= where
    step_s = tick_s(samples)
    errors = errors_of(strokes_of(samples, judged), step_s)
    if not errors.asked.size:
        return Delivered(strokes=strokes(samples))
    slid = samples[judged & sliding(samples) & np.isfinite(samples["target_cof"])]
    return Delivered(
        asked_cof=float(errors.asked.mean()),
        reachable_cof=float(slid["expected_cof"].mean()),
        felt_cof=float(errors.felt.mean()),
        error=float(errors.relative.mean()),
        within_5_percent=float(np.mean(np.abs(errors.relative) <= WITHIN)),
        reachable_share=float(errors.reachable.mean()),
        sliding_s=step_s * errors.asked.size,
        strokes=strokes(samples),
        speed_m_s=float(slid["speed_m_s"].mean()),
        normal_force_n=float(slid["normal_force_n"].mean()),
    )


def why_not_delivered(intervals: list[Delivered], settings: Delivery) -> str:
    """Why a trial cannot be judged, by its first interval for which that is so; empty otherwise."""
    for number, one in enumerate(intervals, start=1):
        if one.sliding_s < max(settings.least_sliding_s, 1e-9):
            return f"interval {number}: the finger slid for {one.sliding_s:.2g} s"
        if one.within_5_percent < settings.least_share:
            said = f"interval {number}: within 5 % for {one.within_5_percent:.0%} of the time"
            return f"{said}; {_limit(one)}"
    return ""


def _limit(one: Delivered) -> str:
    """What kept friction from being as asked, where that was most of it. It is the reach under this
    load, feedback's caution, or what the finger made of a correct command.
    """
    asked, expected = one.asked_cof, one.reachable_cof
    beyond, missed = 1.0 - one.reachable_share, 1.0 - one.within_5_percent
    if beyond >= 0.5 * missed:
        end = "at most" if expected < asked else "at least"
        return (
            f"load: under {one.normal_force_n:.2g} N friction {asked:.3g} is out of this finger's"
            f" reach for {beyond:.0%} of it, {end} {expected:.3g} was expected"
        )
    if abs(expected - asked) > WITHIN * asked:
        return (
            f"feedback's caution: of a finger that it knows little of it asked {expected:.3g}, for"
            f" {asked:.3g}; let the finger slide for some seconds before"
        )
    return (
        f"speed or finger: {expected:.3g} was expected, {one.felt_cof:.3g} was felt at"
        f" {1e3 * one.speed_m_s:.0f} mm/s, for {asked:.3g}"
    )


class Onsets(NamedTuple):
    """When things first happened in an interval, on CLOCK_MONOTONIC; None where they did not.

    The finger may have been there from the first sample on, and the output been on. `onset_s` is
    when something could first be felt: the finger slid, and the output was on. `onset_error_s` is
    from there until the amplifier's monitor showed voltage.
    """

    first_touch_s: float | None
    first_sliding_s: float | None
    output_on_s: float | None
    onset_s: float | None
    onset_error_s: float | None


NO_ONSET = Onsets(None, None, None, None, None)


def onsets(samples: NDArray[np.void]) -> Onsets:
    """Of the samples of one interval, of dtype SAMPLE [n]."""
    touching, on = samples["in_contact"] == 1, samples["output_on"] == 1
    moves = slides(samples)
    onset_s = _first_s(samples, moves & on)
    shown = moves & on & (samples["monitor_voltage_v"] > EDGE_V)
    shown_s = _first_s(samples, shown)
    return Onsets(
        _first_s(samples, touching),
        _first_s(samples, moves),
        _first_s(samples, on),
        onset_s,
        None if onset_s is None or shown_s is None else shown_s - onset_s,
    )


def _first_s(samples: NDArray[np.void], where: Mask) -> float | None:
    found = samples["time_s"][where]
    return float(found[0]) if found.size else None


def strokes(samples: NDArray[np.void]) -> int:
    """How often the finger went more than 3 mm one way, along the axis on which it moves more."""
    touching = samples[samples["in_contact"] == 1]
    if touching.size < 2:
        return 0
    places: list[Array] = [touching["position_x_m"], touching["position_y_m"]]
    along = max(places, key=lambda x: float(np.ptp(x)))
    lifted = np.flatnonzero(gaps(touching))
    return sum(_turns(part) for part in np.split(along, lifted))


def _turns(position_m: Array) -> int:
    """Strokes of one touch: begun anew where the finger has come back by `STROKE_M` from its
    furthest point.
    """
    low = high = float(position_m[0])
    direction, count = 0, 0
    for x in position_m[::5]:
        low, high = min(low, float(x)), max(high, float(x))
        if direction <= 0 and x - low >= STROKE_M:
            direction, count, high = 1, count + 1, float(x)
        elif direction >= 0 and high - x >= STROKE_M:
            direction, count, low = -1, count + 1, float(x)
    return count
