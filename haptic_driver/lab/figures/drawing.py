"""The paper's figures 4-8 drawn: its panels and axes in the upper rows, the printed equations
below.

Measured curves are absent, for the paper prints no numbers of them.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np

from haptic_driver.lab.figures.facts import COF_OFF, COF_OFF_STANDARD_ERROR, LEAST_LOSS_HZ, PEAK_HZ
from haptic_driver.lab.figures.numbers import (
    CHANGED,
    DIELECTRIC_AT_HZ,
    NORMAL_FORCE_N,
    PAPER_HZ,
    STEP_V,
    SWEEP_HZ,
    VOLTAGE_V,
    VOLTAGES_V,
    Charges,
    Sensitivity,
    Touching,
)
from haptic_driver.pictures.saving import draw_into
from model.support.arrays import Array

mpl.use("Agg")
import matplotlib.pyplot as plt
from matplotlib.axes import Axes
from matplotlib.figure import Figure

DARK_BLUE, LIGHT_BLUE, ORANGE, PURPLE = (
    "#1f3b73",
    "#4aa5d8",
    "#e07b12",
    "#7b3fa0",
)  # the paper's colours of Fig. 7
DARK_GREEN, MAGENTA, RED, GREEN, QUIET = "#0b5d1e", "#c2188b", "#c8322f", "#2e8b57", "#8a8f98"
TITLES = {"corrected": "corrected equations", "published": "equations as printed"}
PERCENT_TICKS = (-100.0, -50.0, 0.0, 50.0, 100.0, 300.0, 1000.0, 3000.0)
STATED = {  # section V on Fig. 8
    "insulator_thickness_m": "thinner gives more force",
    "skin_thickness_m": "more effect at high frequency",
    "insulator_permittivity": "most effect at low frequency",
    "skin_modulus_pa": "softer gives more force",
}
PLATE = {"boxstyle": "round,pad=0.2", "fc": "white", "ec": "none", "alpha": 0.85}
NOT_COMPARED = "Not compared with the paper's measured curves: their numbers are not printed."


def save(figure: Figure, path: Path) -> None:
    """As PNG; the same bytes for the same picture."""
    draw_into(figure, path, "png", dpi=130, metadata={"Software": None})
    plt.close(figure)


def figure4(solved: Mapping[str, Touching]) -> Figure:
    """Pressure, mean gap and contact area over the amplitude, one curve per frequency."""
    figure, rows = _panels(2, 3, (15.0, 9.0))
    colours = plt.get_cmap("turbo")(np.linspace(0.02, 0.92, PAPER_HZ.size))
    for row, (name, found) in zip(rows, solved.items(), strict=True):
        columns = (found.pressure_pa / 1e3, found.mean_gap_m * 1e6, found.area_ratio)
        labels = (
            "(a) electrostatic pressure, kPa",
            "(b) mean separation, µm",
            "(c) real over nominal contact area",
        )
        for ax, values, label in zip(row, columns, labels, strict=True):
            for curve, colour, frequency in zip(values, colours, PAPER_HZ, strict=True):
                shown = np.where(VOLTAGES_V > 0.0, curve, np.nan)
                ax.plot(VOLTAGES_V, shown, color=colour, lw=1.6, label=_hertz(frequency))
            ax.axvline(VOLTAGE_V, color=QUIET, lw=1.0, ls=":")
            ax.set(xlabel="voltage amplitude, V", ylabel=label, xlim=(0.0, VOLTAGES_V[-1]))
            if label[1] != "b":
                ax.set_yscale("log")
        row[1].set_ylim(bottom=0.0)
        row[1].set_title(TITLES[name], fontweight="bold")
        row[0].annotate(
            "75 V", (VOLTAGE_V, 0.97), xycoords=("data", "axes fraction"), va="top", color=QUIET
        )
        if np.isnan(found.pressure_pa).any():
            _aside(
                row[0],
                "a curve ends where (29) as printed\nhas no equilibrium",
                (0.97, 0.04),
                ha="right",
            )
    handles, names = rows[0][0].get_legend_handles_labels()
    figure.legend(handles, names, loc="outside right center", title="frequency", frameon=False)
    _caption(
        figure,
        f"Fig. 4: {NORMAL_FORCE_N:g} N. Read along the dotted line for the conditions of Figs. 6"
        " and 7.",
    )
    return figure


def figure5(charges: Mapping[str, Charges]) -> Figure:
    """Charges at both interfaces after a voltage is switched on."""
    figure, rows = _panels(2, 2, (13.0, 9.0))
    colours = plt.get_cmap("plasma")(np.linspace(0.0, 0.85, len(STEP_V)))
    for row, (name, found) in zip(rows, charges.items(), strict=True):
        sides = (
            ("(a) charge at insulator-air", found.rho1_c_per_m2),
            ("(b) charge at air-skin", found.rho2_c_per_m2),
        )
        for ax, (label, rho) in zip(row, sides, strict=True):
            for column, volt, colour in zip(rho.T, STEP_V, colours, strict=True):
                ax.plot(
                    found.at[found.at > 0],
                    1e6 * column[found.at > 0],
                    color=colour,
                    lw=1.8,
                    label=f"{volt:g} V",
                )
            ax.axhline(0.0, color=QUIET, lw=0.8)
            ax.set(xscale="log", xlabel="time since switching on, s", ylabel=f"{label}, µC/m²")
            ax.set_title(TITLES[name], fontweight="bold")
        places = (
            ("positive charges accumulate", (0.02, 0.94)),
            ("negative charges gather", (0.45, 0.88)),
        )
        for ax, (words, place) in zip(row, places, strict=True):
            _aside(ax, f"text: {words} here", place)
    for ax in rows[1]:
        ax.set_yscale("symlog", linthresh=1.0)
    lost = ", ".join(
        f"{v:g} V"
        for v, rho in zip(STEP_V, charges["published"].rho1_c_per_m2[0], strict=True)
        if np.isnan(rho)
    )
    printed = "relative permittivities (slip 6): times too long by 1/ε₀,\ncharges here times ε₀"
    _aside(rows[1][0], printed + (f"; no equilibrium at {lost}" if lost else ""), (0.02, 0.80))
    rows[0][0].legend(loc="center left", frameon=False, title="direct voltage")
    _caption(
        figure,
        "Fig. 5: charges without contact leakage at the mean gap of Fig. 4(b), 1 Hz; skin"
        f" constants at {DIELECTRIC_AT_HZ:g} Hz, for the print's change with frequency (slip 7).",
    )
    return figure


def figure6(charges: Mapping[str, Charges]) -> Figure:
    """Amplitudes of the charges at both interfaces over frequency."""
    figure, (row,) = _panels(1, 2, (14.0, 5.6))
    sides = ((DARK_GREEN, "insulator-air", "rho1_c_per_m2"), (MAGENTA, "air-skin", "rho2_c_per_m2"))
    for ax, name in zip(row, ("corrected", "published"), strict=True):
        for colour, words, side in sides:
            ax.loglog(
                SWEEP_HZ, 1e6 * getattr(charges[name], side), color=colour, lw=2.0, label=words
            )
            if name == "corrected":
                leaking = 1e6 * getattr(charges["with_leak"], side)
                ax.loglog(
                    SWEEP_HZ,
                    leaking,
                    color=colour,
                    lw=1.4,
                    ls="--",
                    label=f"{words}, with contact leakage",
                )
        _mark_peak_frequency(ax)
        ax.set(xlabel="frequency, Hz", ylabel="amplitude of the charge, µC/m²", xlim=(1.0, 1e6))
        ax.set_title(TITLES[name], fontweight="bold")
        ax.margins(y=0.12)
        ax.legend(loc="lower left", frameon=False)
    _caption(
        figure,
        "Fig. 6: steady charges at 75 V and the mean gap of Fig. 4(b); as printed, times ε₀ (slip"
        " 6). The text finds no charge transfer above 250 Hz: facts.csv says what is left there.",
    )
    return figure


def figure7(solved: Mapping[str, Touching], tangent: Array) -> Figure:
    """Force with the loss tangent, separation with area, and the friction that follows."""
    figure, rows = _panels(2, 3, (17.5, 9.4))
    for row, (name, found) in zip(rows, solved.items(), strict=True):
        _force_and_loss(row[0], found, tangent)
        _gap_and_area(row[1], found)
        _friction(row[2], found)
        for ax in row:
            _mark_peak_frequency(ax)
            ax.set(xscale="log", xlabel="frequency, Hz", xlim=(1.0, 1e6))
            ax.set_title(TITLES[name], fontweight="bold")
    _caption(
        figure,
        "Fig. 7: 75 V, 0.5 N. The third column is not in the paper's figure: the friction of Fig."
        " 3(b) as each set of equations has it. " + NOT_COMPARED,
    )
    return figure


def _force_and_loss(ax: Axes, found: Touching, tangent: Array) -> None:
    milli = bool(np.nanmax(found.force_n) > 1e-3)
    force, unit = found.force_n * (1e3 if milli else 1e6), "mN" if milli else "µN"
    ax.plot(SWEEP_HZ, force, color=DARK_BLUE, lw=2.2)
    ten = np.isin(SWEEP_HZ, PAPER_HZ)
    ax.plot(SWEEP_HZ[ten], force[ten], "o", color=DARK_BLUE, ms=4.5)
    ax.set_ylim(0.0, 1.45 * np.nanmax(force))
    ax.set_ylabel(f"(a) electrostatic force, {unit}", color=DARK_BLUE)
    at = int(np.flatnonzero(ten)[np.nanargmax(force[ten])])
    peak = (
        f"largest of the ten: {force[at]:.3g} {unit} at {_hertz(SWEEP_HZ[at])}\n(text: peak at"
        f" about {_hertz(PEAK_HZ)})"
    )
    _note(ax, peak, (SWEEP_HZ[at], force[at]), (0.43, 0.84), DARK_BLUE)
    if at > 0:
        _note(
            ax, f"1 Hz: {force[0]:.3g} {unit},\nnot zero", (1.0, force[0]), (0.08, 0.06), DARK_BLUE
        )
    loss = ax.twinx()
    loss.loglog(SWEEP_HZ, tangent, color=PURPLE, lw=1.6)
    loss.set_ylabel("loss tangent of the skin", color=PURPLE)
    loss.set_ylim(tangent.min() / 30.0, tangent.max() * 2.0)
    least = int(np.argmin(tangent))
    at_hz = _hertz(round(SWEEP_HZ[least], -3))
    text = f"least: {tangent[least]:.3g} at {at_hz}\n(text: about {_hertz(LEAST_LOSS_HZ)})"
    _note(loss, text, (SWEEP_HZ[least], tangent[least]), (0.60, 0.06), PURPLE)


def _gap_and_area(ax: Axes, found: Touching) -> None:
    ax.plot(SWEEP_HZ, found.mean_gap_m * 1e6, color=ORANGE, lw=2.2)
    ax.set_ylabel("(b) mean separation, µm", color=ORANGE)
    ax.margins(y=0.25)
    area = ax.twinx()
    area.plot(SWEEP_HZ, found.area_ratio * 1e4, color=LIGHT_BLUE, lw=2.2)
    area.set_ylabel("real over nominal contact area, 10⁻⁴", color=LIGHT_BLUE)
    area.margins(y=0.25)


def _friction(ax: Axes, found: Touching) -> None:
    ax.plot(SWEEP_HZ, found.cof, color=DARK_BLUE, lw=2.2, label="with 75 V")
    off, error = COF_OFF, COF_OFF_STANDARD_ERROR
    ax.axhspan(
        off - error,
        off + error,
        color=QUIET,
        alpha=0.35,
        lw=0,
        label=f"off: {off} ± {error}, measured",
    )
    ax.set_ylabel("coefficient of friction")
    ax.set_ylim(0.49, max(0.56, 0.49 + 1.35 * (float(np.nanmax(found.cof)) - 0.49)))
    ax.legend(loc="upper right", frameon=False)


def figure8(found: Mapping[str, Mapping[str, Sensitivity]]) -> Figure:
    """Force with four parameters changed by half, and the change in percent."""
    figure, rows = _panels(3, 4, (18.0, 12.0))
    units = {"corrected": (1e3, "mN"), "published": (1e6, "µN")}
    for row, (name, by_parameter) in zip(rows[:2], found.items(), strict=True):
        scale, unit = units[name]
        for letter, ax, (parameter, words) in zip("abcd", row, CHANGED.items(), strict=True):
            s = by_parameter[parameter]
            curves = (
                (s.lower_n, RED, "−50 %"),
                (s.nominal_n, DARK_BLUE, "nominal"),
                (s.higher_n, GREEN, "+50 %"),
            )
            for force, colour, label in curves:
                ax.plot(
                    s.frequency_hz, scale * force, "o-", color=colour, ms=3.5, lw=1.6, label=label
                )
            largest = float(np.nanmax([c[0] for c in curves])) / float(np.nanmin(s.nominal_n))
            ax.set(
                xscale="log", yscale="log" if largest > 30.0 else "linear", xlabel="frequency, Hz"
            )
            if largest <= 30.0:
                ax.set_ylim(bottom=0.0)
            ax.set_title(f"({letter}) {words}\n{TITLES[name]}", fontsize=10, fontweight="bold")
        row[0].set_ylabel(f"electrostatic force, {unit}")
        row[0].legend(loc="best", frameon=False)
    for letter, ax, parameter in zip("efgh", rows[2], CHANGED, strict=True):
        for name, style, as_called in (
            ("corrected", "o-", "corrected"),
            ("published", "x:", "as printed"),
        ):
            s = found[name][parameter]
            for percent, colour, label in (
                (s.lower_percent, RED, "−50 %"),
                (s.higher_percent, GREEN, "+50 %"),
            ):
                ax.plot(
                    s.frequency_hz,
                    percent,
                    style,
                    color=colour,
                    ms=4,
                    lw=1.5,
                    label=f"{label}, {as_called}",
                )
        ax.axhline(0.0, color=QUIET, lw=0.8)
        ax.set_xscale("log")
        ax.set_yscale("symlog", linthresh=100.0)
        changes = [
            (found[n][parameter].lower_percent, found[n][parameter].higher_percent) for n in found
        ]
        highest = float(np.nanmax(changes))
        ax.set_yticks(
            PERCENT_TICKS, [f"{tick:+g}" if tick else "0" for tick in PERCENT_TICKS], minor=False
        )
        ax.set_yticks([], minor=True)
        ax.set(xlabel="frequency, Hz", ylim=(-105.0, max(100.0, 1.4 * highest)))
        ax.set_title(f"({letter}) change of the force\ntext: {STATED[parameter]}", fontsize=10)
    rows[2][0].set_ylabel("change of the force, %\n(linear to ±100 %)")
    handles, names = rows[2][0].get_legend_handles_labels()
    figure.legend(handles, names, loc="outside lower right", ncols=4, frameon=False)
    _caption(
        figure,
        "Fig. 8: 75 V, 0.5 N, at the ten frequencies. Elasticities are in the table beside it.",
    )
    return figure


def _panels(rows: int, columns: int, size: tuple[float, float]) -> tuple[Figure, list[list[Axes]]]:
    figure, axes = plt.subplots(rows, columns, figsize=size, layout="constrained", squeeze=False)
    for ax in axes.ravel():
        ax.grid(alpha=0.25)
    return figure, axes.tolist()


def _caption(figure: Figure, text: str) -> None:
    figure.supxlabel(text, fontsize=10, x=0.01, ha="left", color="#3a3a3a")


def _mark_peak_frequency(ax: Axes) -> None:
    ax.axvline(PEAK_HZ, color=QUIET, lw=1.0, ls=":")
    beside = {"va": "top", "ha": "right", "xytext": (-3, 0), "textcoords": "offset points"}
    _aside(ax, "250 Hz", (PEAK_HZ, 0.985), xycoords=("data", "axes fraction"), **beside)


def _aside(ax: Axes, text: str, place: tuple[float, float], **more: Any) -> None:
    """A remark, in grey and at a share of the panel's width and height unless `more` says
    otherwise.
    """
    ax.annotate(text, place, **{"xycoords": "axes fraction", "color": QUIET, "fontsize": 9, **more})


def _note(
    ax: Axes, text: str, point: tuple[float, float], place: tuple[float, float], colour: str
) -> None:
    line = {"arrowstyle": "-", "color": colour, "lw": 0.8}
    to_point = {
        "xycoords": "data",
        "xytext": place,
        "textcoords": "axes fraction",
        "arrowprops": line,
    }
    _aside(ax, text, point, color=colour, bbox=PLATE, **to_point)


def _hertz(frequency_hz: float) -> str:
    for scale, prefix in ((1e6, "M"), (1e3, "k")):
        if frequency_hz >= scale:
            return f"{frequency_hz / scale:g} {prefix}Hz"
    return f"{frequency_hz:g} Hz"
