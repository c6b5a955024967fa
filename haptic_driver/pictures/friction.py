"""Pictures for people who would rather look than read."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from haptic_driver.errors import BadInputError
from haptic_driver.pictures.files import pyplot, saved
from haptic_driver.signals import WITHIN
from haptic_driver.simulation.slide import SlideRecord, score
from haptic_driver.surface.file import SurfaceFile

TARGET, ACHIEVED, DRIVE = "#d1495b", "#1b6ca8", "#3a3a3a"
DPI = 130


def draw_slide(record: SlideRecord, title: str, path: Path) -> None:
    """Target and achieved friction, voltage and frequency over position; one line per stroke."""
    figure, (friction, voltage, frequency) = pyplot().subplots(
        3, 1, figsize=(9, 8), sharex=True, height_ratios=(3, 2, 1), layout="constrained"
    )
    with saved(figure, path, DPI):
        x_mm = 1e3 * record.slide.position_m
        named: set[str] = set()
        for number, stroke in enumerate(record.strokes):
            x, target = x_mm[stroke], record.target_cof[stroke]
            first = number == 0
            friction.fill_between(
                x, (1 - WITHIN) * target, (1 + WITHIN) * target, color=TARGET, alpha=0.15, lw=0,
                label="target ± 5 %" if first else None,
            )  # fmt: skip
            friction.plot(x, target, color=TARGET, lw=1.5, label="target" if first else None)
            direction, dash = ("to the right", "-") if x[-1] > x[0] else ("to the left", "--")
            label = None if direction in named else f"achieved, {direction}"
            named.add(direction)
            friction.plot(x, record.measured_cof[stroke], color=ACHIEVED, lw=1.0, ls=dash, label=label)
            voltage.plot(x, record.voltage_v[stroke], color=DRIVE, lw=1.0, ls=dash)
            frequency.plot(x, record.frequency_hz[stroke], color=DRIVE, lw=1.0, ls=dash)
        friction.set(ylabel="coefficient of friction")
        figure.suptitle(f"{title} (simulated rig)")
        voltage.set(ylabel="voltage at the electrode, V peak")
        frequency.set(ylabel="carrier, Hz", xlabel="position, mm", yscale="log" if named else "linear")
        if named:
            friction.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=4, frameon=False)
        for axes in (friction, voltage, frequency):
            axes.grid(alpha=0.25)


def draw_before_and_after(records: Mapping[str, SlideRecord], path: Path) -> None:
    """Target and achieved friction over position, the first stroke of each record, one panel each."""
    figure, panels = pyplot().subplots(
        1, len(records), figsize=(10, 4.2), sharex=True, sharey=True, squeeze=False, layout="constrained"
    )
    with saved(figure, path, DPI):
        for axes, (title, record) in zip(panels[0], records.items(), strict=True):
            for stroke in record.strokes[:1]:
                x, target = 1e3 * record.slide.position_m[stroke], record.target_cof[stroke]
                band = (1 - WITHIN) * target, (1 + WITHIN) * target
                axes.fill_between(x, *band, color=TARGET, alpha=0.15, lw=0, label="target ± 5 %")
                axes.plot(x, target, color=TARGET, lw=1.5, label="target")
                axes.plot(x, record.measured_cof[stroke], color=ACHIEVED, lw=1.0, label="achieved")
            share = score(record).share_within_5_percent
            axes.set(title=f"{title}: {share:.0%} within 5 %", xlabel="position, mm")
            axes.grid(alpha=0.25)
        panels[0][0].set(ylabel="coefficient of friction")
        panels[0][0].legend(frameon=False)
        figure.suptitle("friction under a sliding finger (simulated rig)")


def draw_surface(surface: SurfaceFile, normal_force_n: float, path: Path) -> float:
    """Friction over frequency and voltage at the level nearest to `normal_force_n`, which is returned."""
    low, high = surface.normal_force_n[[0, -1]]
    if not low <= normal_force_n <= high:
        said = f"normal force {normal_force_n:g} N is not on the surface"
        raise BadInputError("out_of_range", said, f"Give {low:g} to {high:g} N")
    level = int(np.argmin(np.abs(np.log(surface.normal_force_n / normal_force_n))))
    force_n = float(surface.normal_force_n[level])
    cof = np.ma.masked_invalid(surface.cof[:, :, level].T)
    f, v = surface.frequency_hz, surface.voltage_v
    figure, axes = pyplot().subplots(figsize=(8.5, 5.5), layout="constrained")
    with saved(figure, path, DPI):
        mesh = axes.pcolormesh(f, v, cof, shading="gouraud", cmap="viridis")
        lines = axes.contour(f, v, cof, levels=10, colors="white", linewidths=0.6)
        axes.clabel(lines, fmt="%.2f", fontsize=8)
        forbidden = np.ma.masked_where(surface.within_limits[:, :, level].T, np.ones(cof.shape))
        if forbidden.count():
            axes.contourf(f, v, forbidden, levels=[0.5, 1.5], colors="none", hatches=["////"])
            axes.contour(
                f, v, surface.within_limits[:, :, level].T.astype(float), levels=[0.5], colors=TARGET, linewidths=1.5
            )
        axes.set(xscale="log", xlabel="frequency, Hz", ylabel="voltage at the electrode, V peak")
        name = surface.provenance["model"]["name"]
        axes.set_title(f"friction by model '{name}' under {force_n:.3g} N; hatched: outside the limits")
        figure.colorbar(mesh, label="coefficient of friction")
    return force_n
