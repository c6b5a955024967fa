"""Pictures of textures: how friction lies in the plane, and along a line that a finger might
take.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from haptic_driver.pictures.saving import pyplot, saved
from haptic_driver.render.texture import Script, Target, Texture
from haptic_driver.signals import Array, FingerState
from haptic_driver.textures.reach import SCREEN_M

if TYPE_CHECKING:
    from matplotlib.figure import Figure

WINDOWS_M = (0.010, 0.020, 0.040, 0.080)  # widths that a preview may show
SHOWS_ITSELF = 0.6  # of its friction range, within a quarter of the window
HEIGHT = 0.6  # of the width
MOST_HIGH_IN = 7.0
PIXELS = 960
ALONG = 4000  # places of the line
LINE = "#1b6ca8"
NOWHERE = "#dddddd"


def preview(
    target: Target, path: Path, title: str = "", screen_m: tuple[float, float] = SCREEN_M
) -> None:
    """Draw a texture over the whole screen and along its middle, or a script over time; .png, .pdf
    or .svg by the name.
    """
    figure = preview_figure(target, title, screen_m)
    with saved(figure, path):
        pass


def preview_figure(
    target: Target, title: str = "", screen_m: tuple[float, float] = SCREEN_M
) -> Figure:
    """That picture: the map above the line, a place of the screen at the same x in both."""
    width_in, line_in, edge_in, bar_in = 6.4, 1.9, 0.75, 0.15
    high_in = min(width_in * screen_m[1] / screen_m[0], MOST_HIGH_IN)
    size_in = edge_in + width_in + 1.1, 0.4 + high_in + 0.35 + line_in + 0.55
    figure: Figure = pyplot().figure(figsize=size_in)

    def at(x_in: float, y_in: float, w_in: float, h_in: float) -> Any:
        across, up = size_in
        return figure.add_axes((x_in / across, y_in / up, w_in / across, h_in / up))

    line = at(edge_in, 0.55, width_in, line_in)
    figure.suptitle(title, fontsize="medium", y=1.0 - 0.1 / size_in[1], va="top")
    if isinstance(target, Script):
        _draw_script(target, _ready(target, line))
        return figure
    plane = at(edge_in, 0.9 + line_in, width_in, high_in)
    mesh = _draw(target, plane, line, screen_m)
    y_mm = 0.5e3 * screen_m[1]
    plane.axhline(y_mm, color="white", lw=2.4, alpha=0.6)
    plane.axhline(y_mm, color=LINE, lw=1.0)
    line.set(ylabel=f"friction at y = {y_mm:g} mm")
    plane.set_aspect("auto")
    bar = at(edge_in + width_in + 0.1, 0.9 + line_in, bar_in, high_in)
    figure.colorbar(mesh, cax=bar, label="coefficient of friction")
    return figure


def _ready(target: Target, line: Any) -> Any:
    """Axes with room for all that it asks for."""
    low, high = target.bounds()
    if not low <= high:  # nothing is asked for
        low = high = 0.5
    margin = max(0.1 * (high - low), 0.02)
    line.set(ylabel="friction", ylim=(low - margin, high + margin))
    line.grid(alpha=0.25)
    return line


def _draw(target: Target, plane: Any, line: Any, size_m: tuple[float, float]) -> Any:
    assert isinstance(target, Texture)
    _ready(target, line)
    low, high = target.bounds()
    width_m, height_m = size_m
    x_m, y_m = _centres(width_m, PIXELS), _centres(height_m, round(PIXELS * height_m / width_m))
    cof = np.ma.masked_invalid(target.cof_at(x_m[None, :], y_m[:, None]))
    plane.set_facecolor(NOWHERE)
    size_mm = (0.0, 1e3 * width_m, 1e3 * height_m, 0.0)
    mesh = plane.imshow(
        cof,
        extent=size_mm,
        cmap="viridis",
        vmin=low - 1e-6,
        vmax=high + 1e-6,
        interpolation="nearest",
    )
    plane.set(ylabel="y, mm")
    along_m = _centres(width_m, ALONG)
    middle_m = np.full_like(along_m, 0.5 * height_m)
    line.plot(1e3 * along_m, target.cof_at(along_m, middle_m), color=LINE, lw=1.2)
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
