"""The strokes of a recording, along the axis on which the finger slides farther."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from haptic_driver.errors import BadInputError
from haptic_driver.lab.importers import Asked, Made
from haptic_driver.lab.importers.strokes import Strokes, over_position
from haptic_driver.recording.read import read_run


def made(source: Path, asked: Asked) -> Made:
    """See `importers`."""
    samples = read_run(source, asked.run).samples
    touching = samples[samples["in_contact"] == 1]
    if not touching.size:
        hint = "Give another --run, or record while a finger slides"
        raise BadInputError("bad_strokes", f"{source}: nobody touches in this run", hint)
    axis, direction_deg = max(
        (("x", 0.0), ("y", 90.0)), key=lambda a: float(np.ptp(touching[f"position_{a[0]}_m"]))
    )
    names = (f"position_{axis}_m", "normal_force_n", "lateral_force_n", "speed_m_s")
    position_m, normal_n, lateral_n, speed_m_s = (np.asarray(touching[n], float) for n in names)
    strokes = Strokes(position_m, normal_n, lateral_n, speed_m_s)
    return over_position(strokes, source, asked, direction_deg)
