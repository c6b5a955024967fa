"""Pictures of what the model knows, does not know, and predicts beyond the paper."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from haptic_driver.pictures.saving import pyplot, saved
from haptic_driver.signals import Array
from model.planning.separation import APART

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from model.analysis.calibration import Calibration
    from model.analysis.sensitivity import Sensitivity
    from model.analysis.spectra import ForceSpectrum, Steepness
    from model.planning.resolution import Resolution

MODEL, DATA, QUIET = "#1b6ca8", "#d1495b", "#9aa0a6"
COLOURS = ("#1b6ca8", "#d1495b", "#e08e0b", "#5b8c5a", "#6a4c93", "#3a3a3a")
PERCENTILES = (5, 25, 75, 95)


def draw_resolution(levels: Mapping[str, Resolution], path: Path) -> None:
    """A matrix per way of measuring: true effects down, what could stand for them across; what is
    alike is dark.
    """
    with _panels(path, 1, len(levels), (5.6 * len(levels) + 2.0, 7.0)) as panels:
        for ax, (name, told) in zip(panels, levels.items(), strict=True):
            invisible = told.separation[:, -1] < APART
            shares = np.clip(np.log10(np.maximum(told.separation, 1.0) / APART), -1.0, 1.0)
            shares[invisible, :-1] = np.nan
            ax.imshow(np.ma.masked_invalid(shares), cmap="RdYlGn", vmin=-1.0, vmax=1.0)
            ax.set_xticks(
                range(shares.shape[1]),
                [*map(_plain, told.names), "nothing"],
                rotation=90,
                fontsize=8,
            )
            ax.set_yticks(range(len(told.names)), [_plain(n) for n in told.names], fontsize=8)
            ax.set_facecolor("#d9d9d9")
            ax.set_title(
                f"{name}\nred: could stand for it; grey: the effect leaves no trace", fontsize=9
            )
            ax.set_xlabel("fitted instead")
        panels[0].set_ylabel("true effect")


def _plain(name: str) -> str:
    return name.replace("_", " ")


def draw_calibration(found: Calibration, path: Path) -> None:
    """Measured against fitted friction, whitened residuals over frequency, and what was learnt of
    each parameter.
    """
    data = found.data
    with _panels(path, 1, 3, (13.5, 4.3)) as (fit, residuals, parameters):
        measured, predicted = data.columns["cof"], found.predicted_cof
        fit.plot(predicted, measured, ".", color=DATA, alpha=0.6, ms=4)
        ends = [min(measured.min(), predicted.min()), max(measured.max(), predicted.max())]
        fit.plot(ends, ends, color=MODEL, lw=1.0)
        fit.set(
            xlabel="friction by the fitted model",
            ylabel="measured friction",
            title="without session gains",
        )
        driven = data.driven
        residuals.axhspan(-2.0, 2.0, color=MODEL, alpha=0.12)
        residuals.plot(
            data.columns["frequency_hz"][driven], found.residual[driven], ".", color=DATA, ms=4
        )
        residuals.set(xscale="log", xlabel="frequency, Hz", ylabel="residual, standard deviations")
        residuals.set_title(
            f"chi-square per point {found.chi2_per_point:.2f}; band: 2 standard deviations"
        )
        _draw_parameters(parameters, found)


def _draw_parameters(axes: Axes, found: Calibration) -> None:
    """Prior and posterior of each parameter, relative to the model's own value."""
    shown = [p for p in found.parameters if p.name != "cof_off"]
    for row, p in enumerate(shown):
        middle = float(np.sqrt(p.prior_68[0] * p.prior_68[1]))
        axes.plot(
            np.divide(p.prior_68, middle),
            [row + 0.15] * 2,
            color=QUIET,
            lw=4,
            label="prior" if not row else None,
        )
        label = None if row else "fitted, 68 %"
        axes.plot(
            np.divide(p.interval_68, middle), [row - 0.15] * 2, color=MODEL, lw=4, label=label
        )
        axes.plot(p.value / middle, row - 0.15, "o", color="white", mec=MODEL, ms=6)
    names = [f"{_words(p.name)}\n{p.value:.3g} {'' if p.unit == '1' else p.unit}" for p in shown]
    axes.set_yticks(range(len(shown)), names)
    axes.set(xlabel="relative to the model file", ylim=(-0.6, len(shown) - 0.2))
    axes.axvline(1.0, color=QUIET, lw=0.8)
    axes.legend(frameon=False, loc="upper right", fontsize=8)


def draw_sensitivity(found: Sensitivity, path: Path) -> None:
    """First-order and total Sobol indices of every parameter, one panel per condition."""
    count = len(found.conditions)
    columns = min(count, 3)
    rows = -(-count // columns)
    order = np.argsort(found.total.max(axis=0))
    place = np.arange(order.size)
    with _panels(
        path, rows, columns, (4.3 * columns, 1.4 + 0.3 * order.size * rows), sharey=True
    ) as panels:
        for panel, name, first, total in zip(
            panels, found.conditions, found.first, found.total, strict=False
        ):
            panel.barh(
                place, total[order], color=QUIET, height=0.75, label="with interactions (total)"
            )
            panel.barh(
                place, first[order], color=MODEL, height=0.4, label="by itself (first order)"
            )
            panel.set_yticks(place, [_words(found.names[i]) for i in order])
            panel.set(xlim=(0.0, 1.0), xlabel="share of the variance of the force", title=name)
        for unused in panels[count:]:
            unused.set_visible(False)
        panels[0].legend(frameon=False, fontsize=8, loc="lower right")


def draw_study(
    frequency_hz: Array, highest_cof: Array, reachable: Array, about: str, path: Path
) -> None:
    """Percentiles over fingers of the highest friction [finger, f], and the spread of what is
    offered [finger, 2].
    """
    with _panels(path, 1, 2, (11, 4.5)) as (over_frequency, spread):
        low, quarter, three_quarters, high = np.percentile(highest_cof, PERCENTILES, axis=0)
        over_frequency.fill_between(
            frequency_hz, low, high, color=MODEL, alpha=0.2, label="90 % of fingers"
        )
        over_frequency.fill_between(
            frequency_hz, quarter, three_quarters, color=MODEL, alpha=0.4, label="half of them"
        )
        over_frequency.plot(
            frequency_hz, np.median(highest_cof, axis=0), color=MODEL, label="median"
        )
        over_frequency.set(
            xscale="log", xlabel="frequency, Hz", ylabel="highest friction within the rig's limits"
        )
        over_frequency.legend(frameon=False)
        spread.hist(
            reachable[:, 0], bins="auto", color=QUIET, alpha=0.8, label="lowest: no voltage"
        )
        spread.hist(reachable[:, 1], bins="auto", color=DATA, alpha=0.7, label="highest reachable")
        spread.set(xlabel="coefficient of friction", ylabel="fingers")
        spread.legend(frameon=False)
        spread.figure.suptitle(about)


def draw_force_spectra(spectra: Mapping[str, ForceSpectrum], path: Path) -> None:
    """Lines of the force of several drives, one panel each."""
    with _panels(path, len(spectra), 1, (8, 1.9 * len(spectra)), sharex=True) as panels:
        for panel, (name, spectrum) in zip(panels, spectra.items(), strict=True):
            size = 1e3 * np.abs(spectrum.force_n)
            kept = size > 1e-3 * size.max()
            at = spectrum.frequency_hz[kept]
            panel.vlines(at, 0.0, size[kept], color=MODEL, lw=2)
            panel.plot(at, size[kept], "o", color=MODEL, ms=4)
            panel.set(ylabel="force, mN", ylim=(0.0, 1.15 * size.max()))
            panel.set_xscale("symlog", linthresh=10.0)
            panel.set_title(name, loc="left", fontsize=10)
        panels[-1].set_xlabel("frequency of the force, Hz (0: its mean)")


def draw_impedance(
    frequency_hz: Array, impedances: Mapping[str, NDArray[np.complex128]], path: Path
) -> None:
    """Magnitude and phase of the touch's impedance over frequency."""
    with _panels(path, 2, 1, (7.5, 6), sharex=True) as (magnitude, phase):
        for (name, z), colour in zip(impedances.items(), COLOURS, strict=False):
            magnitude.plot(frequency_hz, np.abs(z), color=colour, label=name)
            phase.plot(frequency_hz, np.degrees(np.angle(z)), color=colour)
        magnitude.set(xscale="log", yscale="log", ylabel="|Z|, ohm")
        phase.set(xlabel="frequency, Hz", ylabel="phase, degrees", ylim=(-95, 5))
        magnitude.legend(frameon=False)


def draw_steepness(found: Steepness, level: int, path: Path) -> None:
    """Where the force turns steep, and where the contact pulls in, under one load."""
    with _panels(path, 1, 1, (7.5, 5)) as (axes,):
        f, v = found.frequency_hz, found.voltage_v[1:]
        exponent = np.ma.masked_invalid(found.exponent[:, 1:, level].T)
        mesh = axes.pcolormesh(f, v, exponent, shading="gouraud", cmap="magma", vmin=2.0)
        lines = axes.contour(
            f, v, exponent, levels=[2.2, 2.5, 3.0, 4.0, 6.0], colors="white", linewidths=0.8
        )
        axes.clabel(lines, fmt="%g")
        pull_in = found.pull_in_v[:, level]
        if np.isfinite(pull_in).any():
            axes.plot(f, pull_in, color="cyan", label="pull-in")
            axes.legend(frameon=False)
        axes.set(xscale="log", xlabel="frequency, Hz", ylabel="voltage at the electrode, V peak")
        axes.set_title(
            f"force grows as voltage to this power, under {found.normal_force_n[level]:.3g} N"
        )
        axes.figure.colorbar(mesh, ax=axes, label="d ln(force)/d ln(voltage)")


def draw_lines(curves: Mapping[str, tuple[Array, Array]], x: str, y: str, path: Path) -> None:
    """Curves (x, y) by name on one pair of axes, x logarithmic."""
    with _panels(path, 1, 1, (7, 4.5)) as (axes,):
        for (name, (at, values)), colour in zip(curves.items(), COLOURS, strict=False):
            axes.plot(at, values, color=colour, label=name)
        axes.set(xscale="log", xlabel=x, ylabel=y)
        axes.legend(frameon=False)


def _words(name: str) -> str:
    """A parameter's name as people say it."""
    for unit in ("_s_per_m", "_per_m", "_m2", "_m", "_pa"):
        name = name.removesuffix(unit)
    return name.replace("_", " ").replace("cof off", "friction off").replace(".", ": ")


@contextmanager
def _panels(path: Path, rows: int, columns: int, size: tuple[float, float], **how: Any) -> Any:
    """Axes [rows x columns] to draw on; saved at the end of the block."""
    figure, axes = pyplot().subplots(
        rows, columns, figsize=size, layout="constrained", squeeze=False, **how
    )
    with saved(figure, path):
        for panel in axes.ravel():
            panel.grid(alpha=0.25)
        yield axes.ravel().tolist()
