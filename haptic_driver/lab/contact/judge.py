"""A film frame by frame: what each shows, and which frames are no use and why."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from math import inf, nan
from typing import Literal, NamedTuple

import numpy as np
from scipy.ndimage import binary_dilation

from haptic_driver.errors import BadInputError
from haptic_driver.lab.contact.light import flattened
from haptic_driver.lab.contact.touch import LEAST_DARKENING, Seen, find_touch, has_ridges
from haptic_driver.signals import Array

Contact = Literal["dark", "bright"]
NO_FINGER, OUTSIDE, GLARE, MOTION, BLURRED = (
    "no finger",
    "partly outside",
    "glare",
    "motion",
    "blurred",
)
ODD = (
    "every other line or column differs, as of interlaced video, a colour sensor's mosaic, or"
    " numbers of two bytes taken for pixels"
)
WHITE = 0.995  # of the most that a camera gives
GUESSED_BY = 8  # frames of a film
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


class Watched(NamedTuple):
    """Every frame of a film, whether contact is dark or bright in it, and what is to be said."""

    found: list[FrameSeen]
    contact: Contact
    said: list[str]


class _Screen(NamedTuple):
    """What all frames are compared with: the bare screen [y, x], if it is known. From `white` on, a
    share of full scale, the camera tells nothing.
    """

    bare: Array | None
    white: float


def watch(
    frames: Callable[[], Iterable[Array]],
    time_s: Array,
    scale_m: float,
    background: Array | None = None,
    contact: Contact | None = None,
    progress: Callable[[], None] = lambda: None,
) -> Watched:
    """Every frame of a film, read more than once: for whether contact is dark or bright, and for
    the bare screen. That is `background` [y, x], or the mean of frames without a finger.

    A bright contact is sought as a dark one in the negative; glare is not told from it.
    """
    every = max(1, len(time_s) // GUESSED_BY)
    guess, why, top, said = _guessed(frames(), scale_m, background, every)
    if contact != guess:
        said += [f"contact is {guess}: {why}"] if why else []
        said += [f"told to be {contact}: look at the outlines"] if contact else []
        contact = contact or guess

    def as_dark() -> Iterator[Array]:
        return (_as_dark(frame, contact) for frame in frames())

    if background is None:
        bare = _empty_screen(as_dark(), scale_m)
    else:
        bare = _as_dark(background, contact)
    screen = _Screen(bare, min(WHITE, top) if contact == "dark" else inf)
    found = []
    for time, frame in zip(time_s, as_dark(), strict=True):
        found.append(_seen(frame, float(time), scale_m, screen))
        progress()
    others = max((one.seen.others for one in found if one.seen), default=0)
    if others:
        said.append(f"a frame has {1 + others} touches: the largest is measured")
    if not has_ridges(scale_m):
        said.append("pixels are too coarse for ridges, for blur and for motion")
    return Watched(_judged_together(found), contact, said)


def _guessed(
    frames: Iterable[Array], scale_m: float, background: Array | None, step: int
) -> tuple[Contact, str, float, list[str]]:
    """Whether contact is dark or bright: as which it stands out more clearly, and by how much, if
    at all. The brightest pixel, and what is to be said of the frames.
    """
    clear: dict[Contact, list[float]] = {"dark": [], "bright": []}
    top, repeats, odd, before = 0.0, 0, False, None
    for number, frame in enumerate(frames):
        top = max(top, float(frame.max()))
        repeats += before is not None and np.array_equal(frame, before)
        before = frame
        if number % step:
            continue
        odd = odd or _alternates(frame)
        for contact, found in clear.items():
            bare = None if background is None else _as_dark(background, contact)
            seen = _touch(_as_dark(frame, contact), scale_m, bare)
            found.append(seen.clarity if seen else 0.0)
    dark, bright = (float(np.mean(found)) if found else 0.0 for found in clear.values())
    better: Contact = "bright" if bright > dark else "dark"
    said = [f"{repeats} frames repeat the one before: they count again"] if repeats else []
    said += [ODD] if odd else []
    times = f"{max(dark, bright):.1f} times the unevenness, {min(dark, bright):.1f} the other way"
    why = f"it stands out by {times}" if max(dark, bright) else ""
    return better, why, top, said


def _alternates(frame: Array) -> bool:
    """Whether lines or columns two apart are more than twice as alike as neighbours."""
    return any(
        np.mean((image[1:] - image[:-1]) ** 2) > 2.0 * np.mean((image[2:] - image[:-2]) ** 2)
        for image in (frame, frame.T)
    )


def _as_dark(image: Array, contact: Contact) -> Array:
    return image if contact == "dark" else 1.0 - image


def _touch(frame: Array, scale_m: float, bare: Array | None) -> Seen | None:
    if bare is not None and bare.shape != frame.shape:
        said = f"the picture of the bare screen is of {bare.shape}, a frame of {frame.shape}"
        raise BadInputError("bad_background", said, "Take it with the same camera and settings")
    return find_touch(flattened(frame, bare), scale_m)


def _empty_screen(frames: Iterable[Array], scale_m: float) -> Array | None:
    """Mean of the frames without a finger; None where every one has one."""
    total, count = None, 0
    for frame in frames:
        if _touch(frame, scale_m, None) is None:
            total = frame if total is None else total + frame
            count += 1
    return None if total is None else np.asarray(total / count)


def _seen(frame: Array, time_s: float, scale_m: float, screen: _Screen) -> FrameSeen:
    seen = _touch(frame, scale_m, screen.bare)
    if seen is None:
        return FrameSeen(time_s, NO_FINGER, None)
    mask = seen.mask
    if mask[0].any() or mask[-1].any() or mask[:, 0].any() or mask[:, -1].any():
        return FrameSeen(time_s, OUTSIDE, seen)
    glare = (frame >= screen.white) & binary_dilation(mask, iterations=5)
    if screen.bare is not None:
        glare &= screen.bare < screen.white
    if screen.white < WHITE:  # the film's brightest pixels, which may be those of the bare screen
        glare &= flattened(frame, screen.bare) > 1.0 + LEAST_DARKENING
    if glare.sum() > MOST_GLARE * mask.sum():
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
