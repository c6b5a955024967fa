"""Strokes of a sliding finger: what was asked of friction, and the forces that were read."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from haptic_driver.fidelity.sliding import runs
from haptic_driver.signals import Array, Mask


class Stroke(NamedTuple):
    """One stroke of uninterrupted sliding contact: arrays [n], evenly spaced in time.

    `asked_cof` is of the moment at which the forces beside it were read, NaN where nothing was
    asked. `lateral_n` is positive against the motion, NaN where it is unknown; so is `normal_n`.
    `reachable` is False where the target lay outside what the surface reaches.
    """

    asked_cof: Array
    lateral_n: Array
    normal_n: Array
    reachable: Mask

    @property
    def felt_cof(self) -> Array:
        """Friction at each tick, not averaged."""
        return self.lateral_n / self.normal_n

    def part(self, start: int, end: int) -> Stroke:
        """The ticks from `start` to before `end`."""
        ticks = slice(start, end)
        forces = (self.lateral_n[ticks], self.normal_n[ticks])
        return Stroke(self.asked_cof[ticks], *forces, self.reachable[ticks])


def known_pieces(strokes: Sequence[Stroke]) -> list[Stroke]:
    """Cut strokes wherever a tick has no target or no forces, so that every tick left has both.

    ValueError where the arrays of a stroke differ in length.
    """
    pieces = []
    for stroke in strokes:
        if len({values.shape for values in stroke}) != 1 or stroke.asked_cof.ndim != 1:
            shapes = ", ".join(str(values.shape) for values in stroke)
            raise ValueError(f"a stroke needs four arrays of the same length, not {shapes}")
        known = np.isfinite(stroke.asked_cof) & np.isfinite(stroke.lateral_n)
        known &= (stroke.asked_cof > 0.0) & (stroke.normal_n > 0.0) & np.isfinite(stroke.normal_n)
        pieces += [stroke.part(start, end) for start, end in runs(known)]
    return pieces


def moving_average(values: Array, ticks: int) -> Array:
    """Centred mean over `ticks`, made odd; at the ends over what there is of the window."""
    half = ticks // 2
    total = np.concatenate([[0.0], np.cumsum(values)])
    place = np.arange(values.size)
    low = np.maximum(place - half, 0)
    high = np.minimum(place + half + 1, values.size)
    return np.asarray((total[high] - total[low]) / (high - low))


def without_line(values: Array, place: Array | None = None) -> Array:
    """Values [..., n] less the straight line of least squares through each row; n of 2 or more.

    They are evenly spaced, or at `place` [n]. It works by sums. scipy's `detrend` calls LAPACK,
    whose threads wait for one another on a busy machine. A measure of 10 s takes 100 ms with it,
    and 4 ms by sums.
    """
    centred = values - values.mean(axis=-1, keepdims=True)
    ramp = np.arange(values.shape[-1]) if place is None else place
    ramp = ramp - ramp.mean()
    slope = np.sum(centred * ramp, axis=-1, keepdims=True) / np.sum(ramp**2)
    return np.asarray(centred - slope * ramp)
