"""The surface and a texture, coarse enough to draw and as JSON can say them."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from haptic_driver.daemon.targets import USUAL_FORCE_N
from haptic_driver.render.texture import Script, Target, Texture
from haptic_driver.surface.file import SurfaceFile
from haptic_driver.textures.reach import screen_grid

SURFACE_POINTS = (60, 40)  # frequency, voltage
SCREEN_POINTS = (100, 60)


def surface_map(surface: SurfaceFile) -> dict[str, Any]:
    """`frequency_hz` [m], `voltage_v` [n] and friction `cof` [m][n] at the usual load."""
    rows, columns = (
        np.unique(np.linspace(0, axis.size - 1, points).round().astype(int))
        for axis, points in zip((surface.frequency_hz, surface.voltage_v), SURFACE_POINTS, strict=True)
    )
    load = int(np.abs(surface.normal_force_n - USUAL_FORCE_N).argmin())
    return {
        "frequency_hz": surface.frequency_hz[rows].tolist(),
        "voltage_v": surface.voltage_v[columns].tolist(),
        "cof": _without_nan(surface.cof[:, :, load][np.ix_(rows, columns)]),
    }


def texture_map(target: Target | None, now_s: float) -> dict[str, Any]:
    """`x_m`, `y_m` and the friction `cof` [y][x] asked for on the screen; of a script, of its step at `now_s`."""
    x_m, y_m = screen_grid(SCREEN_POINTS)
    texture: object = target
    if isinstance(target, Script):
        begun = [step.texture for step in target.steps if target.start_s + step.time_s <= now_s]
        texture = begun[-1] if begun else None
    cof = np.full((y_m.size, x_m.size), math.nan)
    if isinstance(texture, Texture):
        cof = texture.cof_at(x_m[None, :], y_m[:, None])
    return {"x_m": x_m.tolist(), "y_m": y_m.tolist(), "cof": _without_nan(cof)}


def _without_nan(values: NDArray[np.float64]) -> list[list[float | None]]:
    """Rows with None for what is no number, which JSON does not know."""
    return [[value if math.isfinite(value) else None for value in row] for row in values.tolist()]
