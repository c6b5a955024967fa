"""What became of a picture: the friction asked for, what comes of it, and what was cut."""

from __future__ import annotations

from pathlib import Path
from textwrap import fill
from typing import Any

import numpy as np

from haptic_driver.lab.importers.image import Mapped
from haptic_driver.pictures.saving import pyplot, saved
from haptic_driver.pictures.textures import LINE, MOST_HIGH_IN
from haptic_driver.signals import Array

WIDE_TEXT = 52
FELT = "#b8500f"


def asked_and_rendered(
    asked: Array, rendered: Array, pitch_mm: float, mapped: Mapped, path: Path, title: str
) -> None:
    """Draw two frictions [row, column] as maps on one scale, and both along their middle. Beside
    them stands what was made of the picture's brightness.
    """
    rows, columns = asked.shape
    width_mm, height_mm = columns * pitch_mm, rows * pitch_mm
    high_in = min(max(4.0 * rows / columns, 1.6), MOST_HIGH_IN)
    figure, axes = pyplot().subplot_mosaic(
        [["asked", "rendered", "bright"], ["line", "line", "done"]],
        figsize=(13.0, high_in + 3.0),
        height_ratios=(high_in, 2.0),
        layout="constrained",
    )
    with saved(figure, path):
        extent = (0.0, width_mm, height_mm, 0.0)
        ends = {"vmin": float(asked.min()) - 1e-6, "vmax": float(asked.max()) + 1e-6}
        for name, cof in (("asked", asked), ("rendered", rendered)):
            mesh = axes[name].imshow(cof, extent=extent, cmap="viridis", **ends)
            axes[name].set(title=name, xlabel="x, mm", ylabel="y, mm")
            axes[name].axhline(0.5 * height_mm, color=LINE, lw=1.0)
        figure.colorbar(mesh, ax=[axes["asked"], axes["rendered"]], label="friction")
        along_mm = pitch_mm * (np.arange(columns) + 0.5)
        axes["line"].plot(along_mm, asked[rows // 2], color=LINE, lw=1.0, label="asked")
        axes["line"].plot(along_mm, rendered[rows // 2], color=FELT, lw=1.4, label="rendered")
        where = f"friction at y = {0.5 * height_mm:.3g} mm"
        axes["line"].set(xlabel="x, mm", ylabel=where, xlim=(0.0, width_mm))
        axes["line"].grid(alpha=0.25)
        axes["line"].legend()
        _draw_cut(mapped, axes["bright"])
        axes["done"].set_axis_off()
        words = "\n".join(fill(said, WIDE_TEXT, subsequent_indent="  ") for said in mapped.done)
        axes["done"].text(0.0, 1.0, words, va="top", fontsize=8)
        figure.suptitle(title)


def _draw_cut(mapped: Mapped, axis: Any) -> None:
    """How often each brightness is there, and which are cut."""
    low, high = mapped.ends
    axis.hist(mapped.bright.ravel(), bins=128, color=LINE)
    for edge, beyond, side in (
        (low, mapped.bright < low, "left"),
        (high, mapped.bright > high, "right"),
    ):
        axis.axvline(edge, color=FELT, lw=1.4)
        words = f" {100.0 * beyond.mean():.2g} % cut "
        at = axis.get_xaxis_transform()
        axis.text(edge, 0.97, words, transform=at, ha=side, va="top", fontsize=8, color=FELT)
    axis.set(title="brightness", xlabel="share of white", ylabel="pixels", yscale="log")
