"""Pictures of textures: how friction lies in the plane, and along a line that a finger might
take.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from haptic_driver.pictures.saving import pyplot, saved
from haptic_driver.render.texture import Script, Target, Texture
from haptic_driver.signals import Array, FingerState

WINDOWS_M = (0.010, 0.020, 0.040, 0.080)  # widths that a preview may show
SHOWS_ITSELF = 0.6  # of its friction range, within a quarter of the window
HEIGHT = 0.6  # of the width
PIXELS = 480
COLUMNS = 4
LINE = "#1b6ca8"
NOWHERE = "#dddddd"


def preview(target: Target, path: Path, title: str = "") -> None:
    """Draw a texture over the plane and along its middle, or a script over time; .png, .pdf or .svg
    by the name.
    """
    figure, (plane, line) = pyplot().subplots(
        2, 1, figsize=(6.4, 5.6), height_ratios=(3, 2), layout="constrained"
    )
    with saved(figure, path):
        mesh = _draw(target, plane, line)
        figure.suptitle(title)
        if mesh is None:
            plane.remove()
        else:
            figure.colorbar(mesh, ax=plane, label="coefficient of friction")


def contact_sheet(targets: Mapping[str, Target], path: Path) -> None:
    """Draw several on one sheet, their names above them."""
    rows = math.ceil(len(targets) / COLUMNS)
    figure = pyplot().figure(figsize=(3.1 * COLUMNS, 3.2 * rows), layout="constrained")
    with saved(figure, path):
        cells = figure.subfigures(rows, COLUMNS, squeeze=False).ravel()
        for cell, (name, target) in zip(cells, targets.items(), strict=False):
            plane, line = cell.subplots(2, 1, height_ratios=(3, 2))
            if _draw(target, plane, line) is None:
                plane.remove()
            cell.suptitle(name, fontweight="bold")


def _draw(target: Target, plane: Any, line: Any) -> Any:
    low, high = target.bounds()
    margin = max(0.1 * (high - low), 0.02)
    line.set(ylabel="friction", ylim=(low - margin, high + margin))
    line.grid(alpha=0.25)
    if isinstance(target, Script):
        _draw_script(target, line)
        return None
    assert isinstance(target, Texture)
    width_m = _window_m(target)
    x_m, y_m = _centres(width_m, PIXELS), _centres(HEIGHT * width_m, round(HEIGHT * PIXELS))
    cof = np.ma.masked_invalid(target.cof_at(x_m[None, :], y_m[:, None]))
    plane.set_facecolor(NOWHERE)
    size_mm = (0.0, 1e3 * width_m, 1e3 * HEIGHT * width_m, 0.0)
    mesh = plane.imshow(
        cof,
        extent=size_mm,
        cmap="viridis",
        vmin=low - 1e-6,
        vmax=high + 1e-6,
        interpolation="nearest",
    )
    plane.set(ylabel="y, mm")
    middle_m = np.full_like(x_m, 0.5 * HEIGHT * width_m)
    line.plot(1e3 * x_m, target.cof_at(x_m, middle_m), color=LINE, lw=1.2)
    line.set(xlabel="x, mm", xlim=(0.0, 1e3 * width_m))
    return mesh


def _draw_script(script: Script, line: Any) -> None:
    first_s = script.start_s + script.steps[0].time_s
    times_s = np.linspace(first_s, script.end_s, 2000, endpoint=False)
    middle = [
        script.cof_under(FingerState(t, 0.040, 0.024, 0.0, 0.0, 0.0, True))
        for t in times_s.tolist()
    ]
    line.plot(times_s, middle, color=LINE, lw=1.2)
    for marker in script.markers(-math.inf, script.end_s):
        line.axvline(marker.time_s, color="grey", lw=0.8, ls=":")
        line.text(
            marker.time_s,
            0.98,
            f" {marker.label}",
            transform=line.get_xaxis_transform(),
            va="top",
            fontsize=8,
        )
    line.set(xlabel="time, s", xlim=(first_s, script.end_s))


def _window_m(texture: Texture) -> float:
    """The smallest window in a quarter of which a texture shows most of its range, or the
    largest.
    """
    low, high = texture.bounds()
    for width_m in WINDOWS_M[:-1]:
        across_m = _centres(width_m / 4.0, 100)
        cof = texture.cof_at(across_m[None, :], across_m[:, None])
        seen = cof[np.isfinite(cof)]
        if seen.size and np.ptp(seen) >= SHOWS_ITSELF * (high - low):
            return width_m
    return WINDOWS_M[-1]


def _centres(length_m: float, count: int) -> Array:
    return length_m * (np.arange(count) + 0.5) / count
