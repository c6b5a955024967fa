"""The contact area of a row, from what the rig's camera saw of it."""

from __future__ import annotations

from collections.abc import Sequence
from math import hypot, isfinite, sqrt
from typing import NamedTuple

import numpy as np

from haptic_driver.rig.part import PartSection
from haptic_driver.rig.parts.cameras import CameraSection
from hw.camera.contract import Frame

METHOD_STD = 0.01  # of the area: what a method that is within 3 % is off, and a scale


class ContactArea(NamedTuple):
    """Apparent area of a row's touch, its standard deviation, and what leaves it in doubt."""

    area_m2: float
    std_m2: float
    doubts: str = ""


def contact_area(frames: Sequence[Frame], camera: PartSection) -> ContactArea | None:
    """The mean over the frames that count; None where none does, and without a camera."""
    if not frames or not isinstance(camera, CameraSection):
        return None
    # only rigs with a camera need it
    from haptic_driver.lab.contact.film import grey  # noqa: PLC0415
    from haptic_driver.lab.contact.judge import summary, watch  # noqa: PLC0415

    pictures = grey([frame.image for frame in frames])
    time_s = np.array([frame.time_s for frame in frames])
    scale_m, contact = camera.scale_m_per_pixel, camera.contact
    watched = watch(lambda: pictures, time_s, scale_m, contact=contact)
    told = summary(watched.found)
    if not told.counted:
        return None
    scatter = told.area_std_m2 / sqrt(told.counted) if isfinite(told.area_std_m2) else 0.0
    std_m2 = hypot(scatter, METHOD_STD * told.area_m2)
    return ContactArea(told.area_m2, std_m2, "; ".join(watched.said))
