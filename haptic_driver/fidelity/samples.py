"""From the samples of ticks, as ring, recordings and demo have them, to strokes that can be
judged.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from haptic_driver.fidelity.measure import Fidelity, fidelity_of
from haptic_driver.fidelity.perception import Perception
from haptic_driver.fidelity.strokes import Stroke, runs
from haptic_driver.signals import SLIDING_M_S, Array, Mask

AFTER_TOUCH_S = 0.1  # a stroke is judged from so long after the touch on; what comes before, apart


def sliding(samples: NDArray[np.void]) -> Mask:
    """Which samples [n] of dtype SAMPLE have friction: in contact, sliding, with a usable
    reading.
    """
    moves = (samples["in_contact"] == 1) & (samples["speed_m_s"] >= SLIDING_M_S)
    return np.asarray(moves & np.isfinite(samples["measured_cof"]))


def since_touch_s(samples: NDArray[np.void]) -> Array:
    """How long the finger has been there at each sample [n]; inf where it was from the first on."""
    time_s, touching = samples["time_s"], samples["in_contact"] == 1
    begins = touching & ~np.concatenate([[True], touching[:-1]])
    last = np.maximum.accumulate(np.where(begins, time_s, -np.inf)) if time_s.size else time_s
    return np.asarray(time_s - last)


def strokes_of(samples: NDArray[np.void], where: Mask | None = None) -> list[Stroke]:
    """Uninterrupted sliding over a target, from a while after each touch on, or just `where`."""
    judged = sliding(samples) & np.isfinite(samples["target_cof"])
    judged &= since_touch_s(samples) >= AFTER_TOUCH_S if where is None else where
    missed = np.flatnonzero(np.diff(samples["tick"].astype(np.int64)) > 1) + 1
    return [
        _stroke(samples[first:end])
        for start, stop in runs(judged)
        for first, end in _without(missed, start, stop)
    ]


def fidelity_of_samples(
    samples: NDArray[np.void],
    perception: Perception,
    reach_hz: float | None = None,
    noise_n: float = 0.0,
) -> Fidelity:
    """The measure over samples [n] of dtype SAMPLE; see `fidelity_of` and `strokes_of`."""
    return fidelity_of(strokes_of(samples), tick_s(samples), perception, reach_hz, noise_n)


def tick_s(samples: NDArray[np.void]) -> float:
    """How far apart in time ticks are."""
    ticks = np.diff(samples["tick"].astype(np.int64))
    times_s = np.diff(samples["time_s"])
    return float(np.median(times_s / ticks)) if ticks.size else 0.001


def _stroke(samples: NDArray[np.void]) -> Stroke:
    return Stroke(
        samples["target_cof"],
        np.abs(samples["lateral_force_n"]),
        samples["normal_force_n"],
        samples["reachable"] == 1,
    )


def _without(missed: NDArray[np.intp], start: int, stop: int) -> list[tuple[int, int]]:
    """A run of samples, cut where ticks are missing."""
    cuts = missed[(missed > start) & (missed < stop)].tolist()
    edges = [start, *cuts, stop]
    return list(pairwise(edges))
