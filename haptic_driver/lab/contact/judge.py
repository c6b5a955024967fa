"""A film frame by frame: what each shows, and which frames are no use and why."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from math import nan

import numpy as np
from scipy.ndimage import binary_dilation

from haptic_driver.errors import BadInputError
from haptic_driver.lab.contact.light import flattened
from haptic_driver.lab.contact.touch import Seen, find_touch
from haptic_driver.signals import Array

NO_FINGER, OUTSIDE, GLARE, MOTION, BLURRED = (
    "no finger",
    "partly outside",
    "glare",
    "motion",
    "blurred",
)
WHITE = 0.995  # of the most that a camera gives
MOST_GLARE = 2e-3  # of the touch's surroundings
MOVED = 1.35  # times the film's usual blur; where edges overlap, blur is not measured
FADED = 0.7  # of the film's usual contrast of ridges
BLUR_LIMIT_M = 45e-6  # beyond, ridges of a share of 0.4 or 0.6 are off by 3 % and more


@dataclass(frozen=True)
class FrameSeen:
    """One frame; `bad` is empty where it counts. A frame that is only `blurred` has an area and no
    ridge area.
    """

    time_s: float
    bad: str
    seen: Seen | None

    @property
    def counts(self) -> bool:
        """Whether its area may be averaged."""
        return self.bad in ("", BLURRED)

    @property
    def area_m2(self) -> float:
        """Apparent contact area; NaN of a frame that does not count."""
        return self.seen.area_m2 if self.counts and self.seen else nan

    @property
    def ridge_area_m2(self) -> float:
        """Area of the ridges inside; NaN where they are unknown."""
        return self.seen.ridge_area_m2 if not self.bad and self.seen else nan


@dataclass(frozen=True)
class Summary:
    """Means over the frames that count, with the standard deviation of one frame; NaN of none."""

    frames: int
    counted: int
    bad: dict[str, int]
    area_m2: float
    area_std_m2: float
    ridge_area_m2: float


def watch(
    frames: Callable[[], Iterable[Array]],
    time_s: Array,
    scale_m: float,
    background: Array | None = None,
    progress: Callable[[], None] = lambda: None,
) -> list[FrameSeen]:
    """Every frame of a film, read twice where no `background` [y, x] is given and some frame has no
    finger: their mean is it then.
    """
    if background is None:
        background = _empty_screen(frames(), scale_m)
    found = []
    for time, frame in zip(time_s, frames(), strict=True):
        found.append(_seen(frame, float(time), scale_m, background))
        progress()
    return _judged_together(found)


def _empty_screen(frames: Iterable[Array], scale_m: float) -> Array | None:
    """Mean of the frames without a finger; None where every one has one."""
    total, count = None, 0
    for frame in frames:
        if find_touch(flattened(frame, None), scale_m) is None:
            total = frame if total is None else total + frame
            count += 1
    return None if total is None else np.asarray(total / count)


def _seen(frame: Array, time_s: float, scale_m: float, background: Array | None) -> FrameSeen:
    if background is not None and background.shape != frame.shape:
        said = f"the picture of the bare screen is of {background.shape}, a frame of {frame.shape}"
        raise BadInputError("bad_background", said, "Take it with the same camera and settings")
    seen = find_touch(flattened(frame, background), scale_m)
    if seen is None:
        return FrameSeen(time_s, NO_FINGER, None)
    mask = seen.mask
    if mask[0].any() or mask[-1].any() or mask[:, 0].any() or mask[:, -1].any():
        return FrameSeen(time_s, OUTSIDE, seen)
    around = binary_dilation(mask, iterations=5)
    white = (frame >= WHITE) & around
    if background is not None:
        white &= background < WHITE
    if white.sum() > MOST_GLARE * mask.sum():
        return FrameSeen(time_s, GLARE, seen)
    return FrameSeen(time_s, "", seen)


def _judged_together(found: list[FrameSeen]) -> list[FrameSeen]:
    """Frames that are much less sharp than the film's sharper half moved."""
    good = [one.seen for one in found if not one.bad and one.seen]
    usual_m = float(np.quantile([seen.blur_m for seen in good], 0.25)) if good else nan
    usual_contrast = float(np.quantile([seen.contrast for seen in good], 0.75)) if good else nan

    def judged(one: FrameSeen) -> FrameSeen:
        if one.bad or one.seen is None:
            return one
        blurred = one.seen.blur_m > max(MOVED * usual_m, BLUR_LIMIT_M)
        if blurred or one.seen.contrast < FADED * usual_contrast:
            return replace(one, bad=MOTION)
        return replace(one, bad=BLURRED) if one.seen.blur_m > BLUR_LIMIT_M else one

    return [judged(one) for one in found]


def summary(found: Sequence[FrameSeen]) -> Summary:
    """Over a film, or part of one."""
    areas = np.array([one.area_m2 for one in found if one.counts])
    ridges = np.array([one.ridge_area_m2 for one in found if not one.bad])
    return Summary(
        frames=len(found),
        counted=int(areas.size),
        bad=dict(Counter(one.bad for one in found if one.bad)),
        area_m2=float(areas.mean()) if areas.size else nan,
        area_std_m2=float(areas.std(ddof=1)) if areas.size > 1 else nan,
        ridge_area_m2=float(ridges.mean()) if ridges.size else nan,
    )
