"""What a camera is to the driver: started at a row's beginning, read at its end."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

Image = NDArray[np.uint8 | np.uint16]


class Frame(NamedTuple):
    """One picture, grey [y, x] or of colours [y, x, 3], as the camera gave it; `time_s` since the
    trigger.
    """

    time_s: float
    image: Image


class Camera(Protocol):
    """Takes a burst of frames when it is triggered; DeviceError where it cannot."""

    def open(self) -> None:
        """Connect."""

    def close(self) -> None:
        """Stop and hang up."""

    def start(self) -> None:
        """Trigger a burst; what an earlier one left is dropped."""

    def frames(self) -> Sequence[Frame]:
        """What the burst has taken, once it is over; empty where nothing came."""
