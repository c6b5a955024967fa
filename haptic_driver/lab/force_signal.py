"""What a recorded force says of itself: samples that are none of it, a range that ended, a sensor
that stood still.

A signal is an array [n] of a whole record; `chosen` [n] are the samples that are used.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.ndimage import median_filter

from haptic_driver.signals import Array, Mask

FEWEST = 10  # samples
FAR = 20.0  # of a signal's own spread, or of its own repeats: what is beyond is none of it
SLIDES = 0.8  # of what is used; the rest may be missing
ZERO = 0.01  # of the lateral force: a zero that is told


class Clipped(NamedTuple):
    """From which sample on a signal is at the end of its range, and for which share of those
    used.
    """

    at: int
    share: float


def outliers(values: Array, step: float) -> Mask:
    """Samples [n] of a steady stretch far outside its own noise, or without a number.

    No noise is finer than `step`, a count of its converter.

    A short one stands alone by FAR times the noise; a long one is also far beyond all the rest.
    """
    finite = np.isfinite(values)
    if not finite.any():
        return ~finite
    filled = np.where(finite, values, np.median(values[finite]))
    middle = float(np.median(filled))
    off = np.abs(filled - middle)
    residual = np.abs(filled - median_filter(filled, 5, mode="nearest"))
    least = max(step, 1e-9 * abs(middle))
    spread = max(1.5 * float(np.median(off)), least)
    noise = max(1.5 * float(np.median(residual)), least)
    alone = (residual > FAR * noise) & (off > FAR * spread)
    beyond = off > FAR * (abs(middle) + spread)
    return np.asarray(~finite | alone | beyond)


def count_of(values: Array) -> float:
    """The step of a converter, of which all values are multiples; 0 where they are of none."""
    steps = np.diff(np.unique(values[np.isfinite(values)]))
    if steps.size < 2:
        return 0.0
    counts = steps / steps.min()
    return float(steps.min()) if np.allclose(counts, np.rint(counts), atol=1e-3) else 0.0


def noise_of(values: Array) -> float:
    """What three of four steps from sample to sample keep within, of those that are any.

    0 where these are FEWEST, as where a coarse signal rises once.
    """
    steps = np.abs(np.diff(values))
    steps = steps[np.isfinite(steps) & (steps > 0.0)]
    return float(np.percentile(steps, 75.0)) if steps.size > FEWEST else 0.0


def clipped(whole: Array, chosen: Mask) -> Clipped | None:
    """Whether a signal is most often at the least or greatest number that it ever has.

    Its noise elsewhere must be of several counts of its converter. A number far from all others
    stands for none.
    """
    count, finite = count_of(whole), np.isfinite(whole)
    used = chosen & finite
    if used.sum() < FEWEST:
        return None
    each, times = np.unique(whole[used], return_counts=True)
    most = int(np.argmax(times))
    if noise_of(whole[finite & (whole != each[most])]) <= 1.5 * count:
        return None
    others = np.delete(times, most).max(initial=0)
    is_end = each[most] in (whole[finite].min(), whole[finite].max())
    is_none = outliers(whole[used], count)[whole[used] == each[most]].all()
    if not is_end or is_none or times[most] < max(FEWEST, 2 * int(others)):
        return None
    at = int(np.flatnonzero(used & (whole == each[most]))[0])
    return Clipped(at, float(times[most] / used.sum()))


def frozen(whole: Array) -> Mask:
    """Samples [n] that repeat one number for FAR times as long as this signal ever does otherwise.

    Its noise must be of several counts of its converter: a coarse one repeats by itself.
    """
    begins = np.flatnonzero(np.concatenate([[True], whole[1:] != whole[:-1]]))
    lengths = np.diff(np.append(begins, whole.size))
    long = lengths > max(FEWEST, FAR * float(np.percentile(lengths, 95.0)))
    still = np.repeat(long, lengths)
    return np.asarray(still & (noise_of(whole[~still]) > 1.5 * count_of(whole)))
