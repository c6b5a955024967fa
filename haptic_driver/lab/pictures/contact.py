"""Films of the fingerpad: the outline drawn on frames, and areas over time."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from haptic_driver.lab.contact.judge import BLURRED, FrameSeen
from haptic_driver.pictures.saving import pyplot, saved
from haptic_driver.signals import Array

AREA, RIDGES, BAD = "#1b6ca8", "#3a3a3a", "#d1495b"
MOST_FRAMES = 6  # in a picture
BARS_MM = (0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0)


def drawn_frames(found: Sequence[FrameSeen]) -> list[int]:
    """Which frames to draw: evenly over the film, some of those that do not count among them."""
    count = min(MOST_FRAMES, len(found))
    chosen = set(np.linspace(0, len(found) - 1, count).round().astype(int).tolist())
    bad = [i for i, one in enumerate(found) if one.bad]
    if bad and not chosen & set(bad):
        chosen.add(bad[len(bad) // 2])
    return sorted(chosen)


def draw_outlines(
    frames: Sequence[tuple[int, Array, FrameSeen]], mm_per_pixel: float, path: Path, title: str
) -> None:
    """Frames [y, x] with the outline of the touch, and why one does not count; a bar beside each
    has the scale.
    """
    columns = min(3, len(frames))
    rows = -(-len(frames) // columns)
    figure, axes = pyplot().subplots(
        rows, columns, figsize=(4.0 * columns, 3.4 * rows), layout="constrained", squeeze=False
    )
    with saved(figure, path):
        for axis in axes.ravel():
            axis.set_axis_off()
        for axis, (number, image, one) in zip(axes.ravel(), frames, strict=False):
            axis.imshow(image, cmap="gray", vmin=0.0, vmax=1.0)
            if one.seen is not None:
                y, x = one.seen.outline.T
                axis.plot(x, y, color=BAD if one.bad else AREA, lw=1.2)
            _draw_scale(axis, image, mm_per_pixel)
            said = one.bad or f"{1e6 * one.area_m2:.1f} mm²"
            axis.set_title(f"frame {number}, {one.time_s:.3g} s: {said}", fontsize=9)
        figure.suptitle(title, fontsize=10)


def _draw_scale(axis: Any, image: Array, mm_per_pixel: float) -> None:
    """A bar below the picture, of the longest length in `BARS_MM` that fits."""
    height, width = image.shape
    bar_mm = max((mm for mm in BARS_MM if mm < 0.5 * width * mm_per_pixel), default=BARS_MM[0])
    y = 1.04 * height
    axis.plot((0.0, bar_mm / mm_per_pixel), (y, y), color="black", lw=2.5, clip_on=False)
    axis.text(bar_mm / mm_per_pixel, y, f" {bar_mm:g} mm", va="center", fontsize=8)
    axis.set(xlim=(-0.5, width - 0.5), ylim=(height - 0.5, -0.5))


def draw_areas(found: Sequence[FrameSeen], path: Path) -> None:
    """Apparent area and the ridges' over time; frames that do not count are marked below."""
    figure, axis = pyplot().subplots(figsize=(8, 4.5), layout="constrained")
    with saved(figure, path):
        time_s = np.array([one.time_s for one in found])
        for name, color in (("area_m2", AREA), ("ridge_area_m2", RIDGES)):
            values = 1e6 * np.array([getattr(one, name) for one in found])
            label = "apparent area" if name == "area_m2" else "ridges"
            axis.plot(time_s, values, ".-", color=color, lw=1.0, ms=4, label=label)
        bad = np.array([bool(one.bad) and one.bad != BLURRED for one in found])
        if bad.any():
            axis.plot(
                time_s[bad], np.zeros(bad.sum()), "x", color=BAD, label="frames that do not count"
            )
        axis.set(xlabel="time, s", ylabel="area, mm²", ylim=(0.0, None))
        axis.legend(frameon=False)
