"""The paper's figures 3 and 7(a) from one's own data: AliAbbasi et al. 2022."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from haptic_driver.lab.strokes.means import Curve, StrokeMeans
from haptic_driver.pictures.saving import pyplot, saved
from haptic_driver.signals import Array

if TYPE_CHECKING:
    from matplotlib.axes import Axes

DPI = 150
OFF, DATA, PRINTED, WINDOW = "#8a8f98", "#111111", "#b9770e", "#1b6ca8"
MODELS = ("#1f3b73", "#c2188b", "#2e8b57")
LEAST_RANGE_N = 0.2  # of the load that is shown: less would make a drama of noise


class ModelCurve(NamedTuple):
    """What a model says over frequency, under the condition of the data."""

    label: str
    frequency_hz: Array
    cof: Array
    force_n: Array


def draw_figure3(means: StrokeMeans, models: Sequence[ModelCurve], path: Path) -> None:
    """(a) Friction, load and velocity over displacement; (b) steady friction and force over
    frequency.
    """
    plt = pyplot()
    figure = plt.figure(figsize=(13.0, 7.6), layout="constrained")
    with saved(figure, path, DPI):
        grid = figure.add_gridspec(6, 2, width_ratios=(1.15, 1.0))
        friction = figure.add_subplot(grid[:3, 0])
        load = figure.add_subplot(grid[3:5, 0], sharex=friction)
        velocity = figure.add_subplot(grid[5, 0], sharex=friction)
        _strokes(means, friction, load, velocity)
        steady = figure.add_subplot(grid[:3, 1])
        force = figure.add_subplot(grid[3:, 1], sharex=steady)
        _steady_friction(means, models, steady)
        _steady_force(means, models, force, both=True)
        steady.set_title("(b) steady state, mean ± standard error", loc="left", fontsize=11)
        friction.set_title(
            f"(a) mean of {_trials(means)} trials, band ± standard error", loc="left", fontsize=11
        )
        figure.suptitle(_title(means), fontsize=12)


def draw_figure7a(means: StrokeMeans, models: Sequence[ModelCurve], path: Path) -> None:
    """Electrostatic force inferred from the data, and by the models, over frequency."""
    figure, axes = pyplot().subplots(figsize=(7.4, 4.8), layout="constrained")
    with saved(figure, path, DPI):
        _steady_force(means, models, axes, both=False)
        axes.set_title(_title(means), fontsize=11)


def _strokes(means: StrokeMeans, friction: Axes, load: Axes, velocity: Axes) -> None:
    colours = _colours(means)
    for curve in means.curves:
        how: dict[str, Any] = {"color": colours[curve.frequency_hz], "lw": 1.5}
        label = _hertz(curve.frequency_hz) if curve.frequency_hz else "no voltage"
        for axes, values, error in (
            (friction, curve.cof, curve.cof_sem),
            (load, curve.normal_force_n, curve.normal_force_sem_n),
            (velocity, 1e3 * curve.velocity_m_s, 1e3 * curve.velocity_sem_m_s),
        ):
            x_mm = 1e3 * curve.displacement_m
            axes.plot(x_mm, values, label=label, **how)
            band = values - error, values + error
            axes.fill_between(x_mm, *band, color=how["color"], alpha=0.13, lw=0)
    begin_mm, end_mm = (1e3 * end for end in means.window_m)
    for axes in (friction, load, velocity):
        axes.axvspan(begin_mm, end_mm, color=WINDOW, alpha=0.08, lw=0)
        axes.grid(alpha=0.25)
        axes.margins(x=0.01)
    friction.annotate(
        f"steady window, {begin_mm:.0f} to {end_mm:.0f} mm",
        (0.5 * (begin_mm + end_mm), 1.0),
        xycoords=("data", "axes fraction"),
        xytext=(0, -4),
        textcoords="offset points",
        ha="center",
        va="top",
        color=WINDOW,
        fontsize=9,
    )
    friction.set(ylabel="coefficient of friction", ylim=_friction_range(means.curves))
    load.set(ylabel="normal force, N", ylim=_load_range(means))
    velocity.set(ylabel="velocity, mm/s", xlabel="displacement with the voltage up, mm")
    velocity.set_ylim(0.0, 1.25e3 * means.condition.speed_m_s)
    for axes in (friction, load):
        axes.tick_params(labelbottom=False)
    columns = min(len(means.curves), 6)
    friction.legend(loc="lower center", ncols=columns, frameon=False, fontsize=8.5)


def _steady_friction(means: StrokeMeans, models: Sequence[ModelCurve], axes: Axes) -> None:
    steady = means.steady
    for model, colour in zip(models, MODELS, strict=False):
        axes.plot(model.frequency_hz, model.cof, color=colour, lw=1.6, label=model.label)
    axes.errorbar(
        steady.frequency_hz,
        steady.cof,
        steady.cof_sem,
        color=DATA,
        marker="o",
        ms=5,
        lw=1.2,
        capsize=3,
        label="measured",
        zorder=5,
    )
    if steady.trials_off:
        band = steady.cof_off - steady.cof_off_sem, steady.cof_off + steady.cof_off_sem
        axes.axhspan(*band, color=OFF, alpha=0.3, lw=0)
        axes.axhline(steady.cof_off, color=OFF, lw=1.2, label="measured, no voltage")
    axes.set(ylabel="coefficient of friction", xscale="log")
    axes.tick_params(labelbottom=False)
    axes.grid(alpha=0.25)
    axes.margins(y=0.12)
    axes.legend(frameon=False, fontsize=8.5, loc="best")


def _steady_force(
    means: StrokeMeans, models: Sequence[ModelCurve], axes: Axes, *, both: bool
) -> None:
    steady = means.steady
    for model, colour in zip(models, MODELS, strict=False):
        axes.plot(model.frequency_hz, 1e3 * model.force_n, color=colour, lw=1.6, label=model.label)
    inferred = [("inferred by (31), corrected", DATA, steady.corrected_n, steady.corrected_sem_n)]
    if both:
        printed = ("inferred by (31) as printed", PRINTED, steady.printed_n, steady.printed_sem_n)
        inferred.append(printed)
    if steady.trials_off:
        for label, colour, force_n, error_n in inferred:
            axes.errorbar(
                steady.frequency_hz,
                1e3 * force_n,
                1e3 * error_n,
                color=colour,
                marker="s",
                ms=4.5,
                lw=1.2,
                ls="--",
                capsize=3,
                label=label,
                zorder=5,
            )
    else:
        axes.annotate(
            "no force is inferred: fewer than two trials without voltage",
            (0.5, 0.04),
            xycoords="axes fraction",
            ha="center",
            color=PRINTED,
        )
    axes.axhline(0.0, color=OFF, lw=0.8)
    axes.set(ylabel="electrostatic force, mN", xlabel="stimulation frequency, Hz", xscale="log")
    axes.grid(alpha=0.25)
    axes.margins(y=0.1)
    if axes.get_legend_handles_labels()[0]:
        axes.legend(frameon=False, fontsize=8.5, loc="best")


def _colours(means: StrokeMeans) -> dict[float, Any]:
    driven = [curve.frequency_hz for curve in means.curves if curve.frequency_hz]
    shades = pyplot().get_cmap("viridis")(np.linspace(0.0, 0.88, max(len(driven), 1)))
    return {0.0: OFF} | dict(zip(driven, shades, strict=False))


def _friction_range(curves: Sequence[Curve]) -> tuple[float, float]:
    """All that is drawn of the slide under full voltage, with room for the legend below."""
    shown = np.concatenate([curve.cof[curve.displacement_m > 0.0] for curve in curves])
    low, high = np.nanpercentile(shown, [0.5, 99.5])
    return low - 0.3 * (high - low), high + 0.15 * (high - low)


def _load_range(means: StrokeMeans) -> tuple[float, float]:
    shown = np.concatenate([curve.normal_force_n for curve in means.curves])
    shown = shown[np.isfinite(shown)]
    middle = means.condition.normal_force_n
    half = max(0.5 * LEAST_RANGE_N, 1.1 * float(np.abs(shown - middle).max()))
    return max(middle - half, 0.0), middle + half


def _trials(means: StrokeMeans) -> str:
    counts = sorted({curve.trials for curve in means.curves})
    return f"{counts[0]}" if len(counts) == 1 else f"{counts[0]} to {counts[-1]}"


def _title(means: StrokeMeans) -> str:
    rig = str(means.about.get("rig", "?"))
    simulated = " (simulated rig)" if means.about.get("simulated") else ""
    return f"{means.about.get('plan', '?')} on {rig}{simulated}: {means.condition}"


def _hertz(frequency_hz: float) -> str:
    for unit, size in (("MHz", 1e6), ("kHz", 1e3)):
        if frequency_hz >= size:
            return f"{frequency_hz / size:g} {unit}"
    return f"{frequency_hz:g} Hz"
