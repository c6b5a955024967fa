"""The electrode's current over frequency as a picture: Bode's (amount and phase) and Nyquist's
(complex).
"""

from __future__ import annotations

from typing import NamedTuple

import matplotlib as mpl
import numpy as np

from model.diagnosis.data import Measurements
from model.diagnosis.priors import words
from model.diagnosis.witness import CURRENT, CURRENT_PHASE
from model.diagnosis.workflow import Findings
from model.support.arrays import Array, Mask

mpl.use("Agg")
import matplotlib.pyplot as plt
from matplotlib.axes import Axes
from matplotlib.figure import Figure

BEFORE, AFTER, DATA = "#d1495b", "#1b6ca8", "#3a3a3a"
FEWEST = 4  # frequencies of a spectrum
MARKS = {"sliding": "o", "resting": "s", "none": "x"}


class Look(NamedTuple):
    """How one curve is drawn: points where there is no line style."""

    label: str
    style: str
    colour: str


def spectrum(data: Measurements, found: Findings) -> Figure | None:
    """Measured and predicted admittance, less its usual growth with frequency; None without amount
    and phase.
    """
    size, phase = data.of(CURRENT), data.of(CURRENT_PHASE)
    if (
        min(size.sum(), phase.sum()) < FEWEST
        or np.unique(data.columns["frequency_hz"][size]).size < FEWEST
    ):
        return None
    figure, (bode, angle, nyquist) = plt.subplots(1, 3, figsize=(13.0, 4.2), layout="constrained")
    base, chosen = found.hypotheses.base, found.chosen
    shown = [(Look("measured", "", DATA), found.problem.observed)]
    models = [(Look("model as given", "--", BEFORE), base)]
    models += [(Look(f"with {words(chosen.name)}", "-", AFTER), chosen)] if chosen.kinds else []
    for look, model in models:
        shown.append(
            (look, found.problem.predictor.predicted(model.kinds, model.fit.vector[None])[0])
        )
    for look, values in shown:
        _over_frequency(bode, data, size, np.exp(values - _scale(data, CURRENT)) * 1e6, look)
        _over_frequency(angle, data, phase, np.degrees(values), look)
        _nyquist(nyquist, data, values, look)
    bode.set(xscale="log", yscale="log", xlabel="frequency, Hz", ylabel="|I/V|, uS")
    angle.set(xscale="log", xlabel="frequency, Hz", ylabel="phase of the current, degrees")
    nyquist.set(xlabel="Re I/(w V), pF", ylabel="Im I/(w V), pF")
    for ax in (bode, angle, nyquist):
        ax.grid(alpha=0.25)
    handles, labels = bode.get_legend_handles_labels()
    kept = dict(zip(labels, handles, strict=True))
    figure.legend(
        kept.values(), kept.keys(), loc="outside lower center", ncols=len(kept), frameon=False
    )
    figure.suptitle(
        "The electrode's current: Bode (left) and Nyquist (right), stray current included",
        fontsize=11,
    )
    return figure


def _scale(data: Measurements, witness: int) -> Array:
    """Log of the voltage [n] by which a current is still to be divided: the set one where none was
    measured.
    """
    measured = np.zeros(data.count, bool)
    measured[data.of(witness)] = data.against(witness)
    return np.where(measured, 0.0, np.log(np.maximum(data.columns["voltage_v"], 1e-12)))


def _over_frequency(ax: Axes, data: Measurements, mine: Mask, values: Array, look: Look) -> None:
    for finger, mark in MARKS.items():
        rows = np.flatnonzero(
            mine & (data.sliding if data.finger is None else data.finger == finger)
        )
        if not rows.size or (data.finger is None and finger != "sliding"):
            continue
        f = data.columns["frequency_hz"][rows]
        if not look.style:
            name = "no finger" if finger == "none" else finger
            ax.plot(
                f,
                values[rows],
                mark,
                ms=4,
                color=look.colour,
                label=f"{look.label}, {name}",
                alpha=0.7,
            )
        else:
            at = np.unique(f)
            medians = [np.median(values[rows][f == x]) for x in at]
            ax.plot(at, medians, look.style, color=look.colour, label=look.label)


def _nyquist(ax: Axes, data: Measurements, values: Array, look: Look) -> None:
    """I/(w V) in the complex plane: a capacitance points up, a leak to the right."""
    size, phase = np.flatnonzero(data.of(CURRENT)), np.flatnonzero(data.of(CURRENT_PHASE))
    rows = np.arange(data.count) if data.row is None else data.row
    _, i, j = np.intersect1d(rows[size], rows[phase], return_indices=True)
    amount, turn = size[i], phase[j]
    with_finger = data.sliding[amount]
    amount, turn = amount[with_finger], turn[with_finger]
    f = data.columns["frequency_hz"][amount]
    farads = np.exp(values[amount] - _scale(data, CURRENT)[amount] + 1j * values[turn]) / (
        2.0 * np.pi * f
    )
    order = np.argsort(f)
    x, y = farads.real[order] * 1e12, farads.imag[order] * 1e12
    ax.plot(x, y, look.style or "o", ms=4, alpha=1.0 if look.style else 0.7, color=look.colour)
    ax.set_xscale("symlog", linthresh=10.0)
    ax.set_yscale("symlog", linthresh=10.0)
