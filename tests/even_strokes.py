"""Slides at one speed, and slides as files, for what is compared over speeds."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from haptic_driver.rig.slide import COLUMNS, Slide
from haptic_driver.signals import TICK_S, Array


def even_strokes(speed_m_s: float, touches: int = 2) -> Slide:
    """Touches of 2 s with 0.4 s between them: there and back over up to 85 mm at a speed, under
    about 0.5 N.
    """
    touch_s, lift_s, length_m = 2.0, 0.4, 0.085
    count = round((touch_s + lift_s) / TICK_S)
    time = np.asarray(np.arange(touches * count) * TICK_S, dtype=np.float64)
    since = time % (touch_s + lift_s)
    way_m = speed_m_s * (np.minimum(since, touch_s) + touch_s * (time // (touch_s + lift_s)))
    back_m = way_m % (2.0 * length_m)
    x_m = 0.005 + np.minimum(back_m, 2.0 * length_m - back_m)
    press = _least_jerk(since, 0.0, 0.06) - _least_jerk(since, touch_s - 0.06, 0.06)
    load = press * (0.50 + 0.05 * np.sin(2.0 * np.pi * 0.9 * time))
    return Slide(f"strokes at {1e3 * speed_m_s:g} mm/s", time, _rounded(x_m), load)


def write_slide(slide: Slide, path: Path) -> None:
    """As `read_slide` reads it."""
    table = np.column_stack([slide.time_s, slide.position_m, slide.normal_force_n])
    np.savetxt(path, table, delimiter=",", header=",".join(COLUMNS), comments="")


def _rounded(x_m: Array) -> Array:
    """A finger turns round within 40 ms, not at once."""
    half = 20
    window = np.hanning(2 * half + 1)
    return np.asarray(np.convolve(np.pad(x_m, half, mode="edge"), window / window.sum(), "valid"))


def _least_jerk(time: Array, start_s: float, duration_s: float) -> Array:
    """0 to 1 with least jerk."""
    x = np.clip((time - start_s) / duration_s, 0.0, 1.0)
    return np.asarray(x**3 * (10.0 - 15.0 * x + 6.0 * x * x))
