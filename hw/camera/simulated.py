"""A camera that draws the touch of a given area."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from hw.camera.contract import Frame
from hw.camera.fingerprint import Optics, Touch, bare, drawn

STUCK_M = 0.4e-3  # how far a sliding finger is drawn along


class Finger(NamedTuple):
    """What of a finger the camera sees; an area of 0 where there is none."""

    time_s: float
    area_m2: float
    speed_m_s: float


@dataclass(frozen=True)
class Burst:
    """How many frames a trigger gives, and how far apart."""

    count: int = 5
    interval_s: float = 0.1


class SimulatedCamera:
    """Asks `finger` where its touch is when a burst is over, and draws frames of it.

    See `Camera`. `seed` decides ridges and noise.
    """

    def __init__(
        self,
        finger: Callable[[], Finger],
        optics: Optics | None = None,
        burst: Burst | None = None,
        *,
        seed: int = 1,
    ) -> None:
        self._finger = finger
        self._optics = optics or Optics()
        self._burst = burst or Burst()
        self._random = np.random.default_rng(seed)
        self._began_s: float | None = None

    def open(self) -> None:
        """See `Camera`."""

    def close(self) -> None:
        """See `Camera`."""
        self._began_s = None

    def start(self) -> None:
        self._began_s = self._finger().time_s

    def frames(self) -> Sequence[Frame]:
        finger, began_s = self._finger(), self._began_s
        self._began_s = None
        if began_s is None:
            return []
        duration_s = finger.time_s - began_s
        times_s = self._burst.interval_s * np.arange(1, self._burst.count + 1)
        return [Frame(float(t), self._picture(finger)) for t in times_s if t <= duration_s]

    def _picture(self, finger: Finger) -> np.ndarray[tuple[int, ...], np.dtype[np.uint8]]:
        if finger.area_m2 <= 0.0:
            return bare(self._optics, self._random)
        drawn_along_m = STUCK_M * float(np.sign(finger.speed_m_s))
        touch = replace(Touch(finger.area_m2), x_m=drawn_along_m)
        return drawn(touch, self._optics, self._random).image
