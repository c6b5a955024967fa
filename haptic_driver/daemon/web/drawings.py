"""The surface and textures, as fine as they are drawn and as JSON can say them."""

from __future__ import annotations

import math
from base64 import b64encode
from typing import Any

import numpy as np
from numpy.typing import NDArray

from haptic_driver.daemon.loader import Loader
from haptic_driver.daemon.messages import Tile, TileRequest
from haptic_driver.daemon.targets import USUAL_FORCE_N
from haptic_driver.limits import OperatingLimits
from haptic_driver.lookup.file import SurfaceFile
from haptic_driver.render.texture import Script, Target, Texture
from haptic_driver.signals import Array
from haptic_driver.textures.reach import screen_grid
from haptic_driver.textures.tile import Grid

SURFACE_POINTS = (120, 60)  # frequency, voltage
ABOVE = 1.15  # times the highest voltage that is allowed anywhere, so that the limits are seen
SCREEN_POINTS = (100, 60)


def surface_map(surface: SurfaceFile, limits: OperatingLimits) -> dict[str, Any]:
    """What `GET /surface` answers: the part of a surface that a rig may use, and a little above."""
    load = int(np.abs(surface.normal_force_n - USUAL_FORCE_N).argmin())
    limits_v = _limits_v(surface, limits, load)
    highest_v = ABOVE * np.minimum.reduce(list(limits_v.values())).max()
    in_band = (surface.frequency_hz >= limits.frequency_low_hz) & (
        surface.frequency_hz <= limits.frequency_high_hz
    )
    rows, columns = (
        used[np.unique(np.linspace(0, used.size - 1, min(points, used.size)).round().astype(int))]
        for used, points in zip(
            (np.flatnonzero(in_band), np.flatnonzero(surface.voltage_v <= highest_v)),
            SURFACE_POINTS,
            strict=True,
        )
    )
    return {
        "frequency_hz": surface.frequency_hz[rows].tolist(),
        "voltage_v": surface.voltage_v[columns].tolist(),
        "cof": _without_nan(surface.cof[:, :, load][np.ix_(rows, columns)]),
        "limits_v": {
            name: _without_nan(highest[None, rows])[0] for name, highest in limits_v.items()
        },
    }


def _limits_v(surface: SurfaceFile, limits: OperatingLimits, load: int) -> dict[str, Array]:
    """The highest voltage [f] by each limit, infinite where it has none; a straight line between
    nodes of voltage.
    """
    v, current_a = surface.voltage_v, surface.current_rms_a[:, :, load]
    allowed_a = limits.contact_current_limit_a_rms(surface.frequency_hz)
    by_current = [
        np.interp(most, one[np.isfinite(one)], v[np.isfinite(one)], right=math.inf)
        for most, one in zip(allowed_a, current_a, strict=True)
    ]
    sound = surface.within_theory[:, :, load] & ~surface.pulled_in[:, :, load]
    by_theory = np.where(
        sound.all(axis=1), math.inf, v[np.maximum(np.argmin(sound, axis=1) - 1, 0)]
    )
    return limits.highest_within_by_limit_v(surface.worst_case(limits)) | {
        "finger current": np.array(by_current),
        "validity of the model": by_theory,
    }


def texture_map(target: Target | None, now_s: float) -> dict[str, Any]:
    """`x_m`, `y_m` and the friction `cof` [y][x] asked for on the screen; of a script, of its step
    at `now_s`.
    """
    x_m, y_m = screen_grid(SCREEN_POINTS)
    texture: object = target
    if isinstance(target, Script):
        begun = [step.texture for step in target.steps if target.start_s + step.time_s <= now_s]
        texture = begun[-1] if begun else None
    cof = np.full((y_m.size, x_m.size), math.nan)
    if isinstance(texture, Texture):
        cof = texture.cof_at(x_m[None, :], y_m[:, None])
    return {"x_m": x_m.tolist(), "y_m": y_m.tolist(), "cof": _without_nan(cof)}


def tile(painter: Loader, asked: TileRequest) -> Tile:
    """What `GET /tile` answers, made in the painter's process. Raises HapticError."""
    grid = Grid(asked.x_m, asked.y_m, asked.pitch_m, asked.columns, asked.rows)
    low, high, levels = painter.tile(asked.name, grid)
    said = b64encode(levels).decode()
    return Tile(columns=grid.columns, rows=grid.rows, cof_low=low, cof_high=high, levels=said)


def _without_nan(values: NDArray[np.float64]) -> list[list[float | None]]:
    """Rows with None for what is no number, which JSON does not know."""
    return [[value if math.isfinite(value) else None for value in row] for row in values.tolist()]
