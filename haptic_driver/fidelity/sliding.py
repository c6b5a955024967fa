"""Steady sliding, cut from samples: runs, gaps, turns, and how far back each began."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from haptic_driver.signals import SLIDING_M_S, Array, Mask

AFTER_TOUCH_S = 0.1  # after a touch or turn, until friction is judged; what comes before, apart


def slides(samples: NDArray[np.void]) -> Mask:
    """Which samples [n] of dtype SAMPLE are of a finger that moves over the screen."""
    moves = samples["speed_m_s"] >= SLIDING_M_S
    return np.asarray((samples["in_contact"] == 1) & moves)


def sliding(samples: NDArray[np.void]) -> Mask:
    """Those of them that have a usable reading of friction."""
    return np.asarray(slides(samples) & np.isfinite(samples["measured_cof"]))


def runs(mask: Mask, breaks: Mask | None = None) -> list[tuple[int, int]]:
    """Start and end of each run of True, the end not included; a new one begins at each break."""
    begins = np.diff(mask, prepend=False)
    edges = np.flatnonzero(begins if breaks is None else begins | breaks).tolist()
    return [(start, end) for start, end in pairwise([*edges, mask.size]) if mask[start]]


def gaps(samples: NDArray[np.void]) -> Mask:
    """Which samples [n] come later than a tick after the one before."""
    ticks = samples["tick"].astype(np.int64)
    return np.asarray(np.diff(ticks, prepend=ticks[:1]) > 1)


def turns(side: Array) -> Mask:
    """Which values [n] have another sign than the one before; the first counts if it has any."""
    return np.asarray(np.diff(np.sign(side), prepend=0.0) != 0.0)


def since(along: Array, begins: Mask) -> Array:
    """How far each place [n] along a time or way is from the last at which something began.

    Before the first it is infinitely far.
    """
    last = np.maximum.accumulate(np.where(begins, np.arange(along.size), -1))
    return np.asarray(np.where(last < 0, np.inf, np.abs(along - along[last])))


def since_touch_s(samples: NDArray[np.void]) -> Array:
    """How long the finger has been there at each sample [n]; inf where it was from the first on."""
    touching = samples["in_contact"] == 1
    return since(samples["time_s"], touching & np.diff(touching, prepend=True))
