"""From the samples of ticks, as ring, recordings and demo have them, to strokes that can be
judged.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from haptic_driver.fidelity.measure import Fidelity, fidelity_of
from haptic_driver.fidelity.perception import Perception
from haptic_driver.fidelity.sliding import AFTER_TOUCH_S, gaps, runs, since_touch_s, sliding
from haptic_driver.fidelity.strokes import Stroke
from haptic_driver.signals import Mask


def strokes_of(samples: NDArray[np.void], where: Mask | None = None) -> list[Stroke]:
    """Uninterrupted sliding over a target, from a while after each touch on, or just `where`."""
    judged = sliding(samples) & np.isfinite(samples["target_cof"])
    judged &= since_touch_s(samples) >= AFTER_TOUCH_S if where is None else where
    return [_stroke(samples[start:end]) for start, end in runs(judged, gaps(samples))]


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
