"""Pictures for people who would rather look than read."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from haptic_driver.errors import BadInputError
from haptic_driver.lookup.file import SurfaceFile
from haptic_driver.pictures.saving import pyplot, saved
from haptic_driver.signals import WITHIN, Array, Mask
from haptic_driver.simulation.slide import SlideRecord

if TYPE_CHECKING:
    from matplotlib.axes import Axes

TARGET, ACHIEVED, DRIVE = "#d1495b", "#1b6ca8", "#3a3a3a"
DPI = 130
# nodes of frequency: a step of the limit that is longer is one of the limit itself, not of the
# nodes
FLAT = 15


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
                x,
                (1 - WITHIN) * target,
                (1 + WITHIN) * target,
                color=TARGET,
                alpha=0.15,
                lw=0,
                label="target ± 5 %" if first else None,
            )
            friction.plot(x, target, color=TARGET, lw=1.5, label="target" if first else None)
            direction, dash = ("to the right", "-") if x[-1] > x[0] else ("to the left", "--")
            what = "estimated" if record.is_estimated else "achieved"
            label = None if direction in named else f"{what}, {direction}"
            named.add(direction)
            felt = record.measured_cof
            if record.is_estimated:
                felt, std = (record.samples[f"estimated_cof{part}"] for part in ("", "_std"))
                low, high = (felt + sign * std for sign in (-1.0, 1.0))
                friction.fill_between(
                    x, low[stroke], high[stroke], color=ACHIEVED, alpha=0.08, lw=0
                )
            friction.plot(x, felt[stroke], color=ACHIEVED, lw=1.0, ls=dash, label=label)
            voltage.plot(x, record.voltage_v[stroke], color=DRIVE, lw=1.0, ls=dash)
            frequency.plot(x, record.frequency_hz[stroke], color=DRIVE, lw=1.0, ls=dash)
        friction.set(ylabel="coefficient of friction")
        figure.suptitle(f"{title} (simulated rig)")
        voltage.set(ylabel="electrode, V peak")
        frequency.set(ylabel="carrier, Hz", xlabel="position, mm")
        _scale_carrier(frequency, record.frequency_hz)
        if named:
            friction.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=4, frameon=False)
        for axes in (friction, voltage, frequency):
            axes.grid(alpha=0.25)


def _scale_carrier(axes: Axes, frequency_hz: Array) -> None:
    """Logarithmic over decades; else numbers that can be read off, with some room around one."""
    shown = frequency_hz[np.isfinite(frequency_hz) & (frequency_hz > 0.0)]
    if not shown.size:
        return
    low_hz, high_hz = float(shown.min()), float(shown.max())
    if high_hz > 10.0 * low_hz:
        axes.set(yscale="log")
    else:
        axes.set(ylim=(0.9 * low_hz, 1.1 * high_hz))


def draw_ticks(ticks: NDArray[np.void], path: Path) -> None:
    """Friction asked and measured, and the voltage commanded, over time; of dtype SAMPLE."""
    figure, (friction, voltage) = pyplot().subplots(
        2, 1, figsize=(9, 5.5), sharex=True, height_ratios=(3, 2), layout="constrained"
    )
    with saved(figure, path, DPI):
        start_s = ticks["time_s"].min(initial=np.inf)
        felt_s = ticks["felt_time_s"] - start_s
        friction.plot(felt_s, ticks["target_cof"], color=TARGET, lw=1.5, label="asked")
        friction.plot(felt_s, ticks["measured_cof"], color=ACHIEVED, lw=1.0, label="measured")
        voltage.plot(ticks["time_s"] - start_s, ticks["voltage_v"], color=DRIVE, lw=1.0)
        friction.set(ylabel="coefficient of friction")
        friction.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2, frameon=False)
        voltage.set(xlabel="time, s", ylabel="electrode, V peak")
        for axes in (friction, voltage):
            axes.grid(alpha=0.25)


def draw_surface(surface: SurfaceFile, normal_force_n: float, path: Path) -> None:
    """Friction over frequency and voltage under a load that the surface has; colours end where
    limits do.
    """
    low, high = surface.normal_force_n[[0, -1]]
    if not low <= normal_force_n <= high:
        said = f"normal force {normal_force_n:g} N is not on the surface"
        raise BadInputError("out_of_range", said, f"Give {low:g} to {high:g} N")
    values, allowed = surface.section(normal_force_n)
    cof = np.ma.masked_invalid(values.T)
    f, v = surface.frequency_hz, surface.voltage_v
    felt = cof[allowed.T] if allowed.any() else cof
    figure, axes = pyplot().subplots(figsize=(8.5, 5.5), layout="constrained")
    with saved(figure, path, DPI):
        mesh = axes.pcolormesh(
            f, v, cof, shading="gouraud", cmap="viridis", vmin=felt.min(), vmax=felt.max()
        )
        lines = axes.contour(f, v, cof, levels=10, colors="white", linewidths=0.6)
        # beside the ridge, where nothing is hatched
        column = np.searchsorted(f, f[cof.max(axis=0).argmax()] / 4.0)
        at_v = np.interp(lines.levels, cof[:, column], v)
        places = [(f[column], volts) for volts in at_v if v[0] < volts < 0.97 * v[-1]]
        for label in axes.clabel(lines, fmt="%.2f", fontsize=8, inline=False, manual=places):
            label.set(rotation=0.0, va="bottom")
        limit_hz, limit_v = _limit(allowed, f, v)
        axes.fill_between(
            limit_hz,
            limit_v,
            v[-1],
            facecolor="none",
            edgecolor="black",
            hatch="////",
            linewidth=0.0,
        )
        axes.plot(limit_hz, limit_v, color=TARGET, lw=1.5)
        axes.set(
            xscale="log",
            xlabel="frequency, Hz",
            ylabel="voltage at the electrode, V peak",
            ylim=v[[0, -1]],
        )
        name = surface.provenance["model"]["name"]
        axes.set_title(
            f"friction by model '{name}' under {normal_force_n:g} N; hatched: outside the limits"
        )
        beyond = "max" if cof.max() > felt.max() else "neither"
        figure.colorbar(mesh, label="coefficient of friction", extend=beyond)


def _limit(allowed: Mask, frequency_hz: Array, voltage_v: Array) -> tuple[Array, Array]:
    """The line below which points [f, v] are allowed: straight between the middles of its steps."""
    last = np.where(allowed.all(axis=1), voltage_v.size, np.argmin(allowed, axis=1)) - 1
    starts = np.concatenate([[0], np.flatnonzero(np.diff(last)) + 1, [last.size]])
    corners = [
        [a, b - 1] if b - a > FLAT else [(a + b - 1) // 2] for a, b in pairwise(starts.tolist())
    ]
    at = np.concatenate(corners)
    return frequency_hz[at], voltage_v[np.maximum(last, 0)][at]
