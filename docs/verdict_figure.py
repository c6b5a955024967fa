"""The figure of docs/verdict.md: hypotheses, posterior and decision of one data set.

`python docs/verdict_figure.py` writes `pictures/verdict.svg`; `make docs` does. The evidences are
those of one kept set of the tests; what is drawn of them comes from the program. Needs a checkout.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np

from model.diagnosis.decide import decide
from model.diagnosis.hypotheses import Evidences
from model.diagnosis.posterior import Names, Posterior, posterior
from model.diagnosis.priors import (
    NONE,
    PRIOR_EFFECTS,
    PRIOR_NONE,
    PRIOR_UNKNOWN,
    SURE,
    UNKNOWN,
    words,
)
from model.effects import CATALOGUE

mpl.use("Agg")
import matplotlib.pyplot as plt
from matplotlib.axes import Axes
from matplotlib.figure import Figure

ROOT = Path(__file__).resolve().parents[1]
KEPT = ROOT / "tests" / "model" / "diagnosis" / "frozen_evidences.json"
PICTURE = ROOT / "docs" / "pictures" / "verdict.svg"
SET = "064-friction"
SHOWN = 6  # of the most probable hypotheses, beside none and unknown
INCLUDED = 4  # of the most probable effects
SIZE_IN, WIDTHS = (13.0, 4.2), (1.0, 1.0, 1.4)
BLUE, ORANGE, GREY = "#1b6ca8", "#e08e0b", "#9aa0a6"
SETTINGS: dict[Any, Any] = {"svg.hashsalt": "verdict", "font.size": 10}


def evidences() -> Evidences:
    """What was fitted to the set."""
    kept = next(one for one in json.loads(KEPT.read_text(encoding="utf-8")) if one["set"] == SET)
    return Evidences(
        {tuple(name.split("+")): log for name, log in kept["alone"].items()},
        tuple(kept["untestable"]),
        kept["unseen"],
        {(name,): log for name, log in kept["beside"].items()},
        kept["outside"],
    )


def prior(names: Names) -> float:
    known: dict[Names, float] = {(NONE,): PRIOR_NONE, (UNKNOWN,): PRIOR_UNKNOWN}
    return known.get(names, (PRIOR_EFFECTS / len(CATALOGUE)) ** len(names))


def drawn() -> Figure:
    """The three steps side by side."""
    weighed = posterior(evidences())
    effects = [names for names in weighed.hypotheses if not {NONE, UNKNOWN} & set(names)]
    shown = [*effects[:SHOWN], (UNKNOWN,), (NONE,)]
    figure, axes = plt.subplots(1, 3, figsize=SIZE_IN, width_ratios=WIDTHS, layout="constrained")
    _draw_evidences(axes[0], weighed, shown)
    _draw_probabilities(axes[1], weighed, shown)
    _draw_inclusion(axes[2], weighed)
    return figure


def _draw_evidences(ax: Axes, weighed: Posterior, shown: list[Names]) -> None:
    """What the data say of every hypothesis, and its prior."""
    logs = np.log([weighed.hypotheses[names] / prior(names) for names in shown])
    _bars(ax, [_named(names) for names in shown], np.exp(logs - logs[-1]), GREY)
    for y, names in enumerate(shown):
        _beside(ax, f"{prior(names):.2g}", y)
    _beside(ax, "prior", -0.9)
    ax.set(xscale="log", xlabel="evidence over that of nothing")
    ax.set_title("1. Hypotheses", loc="left", fontweight="bold")


def _beside(ax: Axes, text: str, y: float) -> None:
    """Right of the bars."""
    ax.annotate(text, (1.03, y), xycoords=("axes fraction", "data"), va="center", color=ORANGE)


def _draw_probabilities(ax: Axes, weighed: Posterior, shown: list[Names]) -> None:
    values = [weighed.hypotheses[names] for names in shown]
    _bars(ax, [_named(names) for names in shown], values, BLUE)
    ax.set_yticklabels([])
    for y, value in enumerate(values):
        _at_end(ax, value, y)
    ax.set(xlim=(0.0, 1.0), xlabel="probability: prior times evidence")
    ax.set_title("2. Posterior", loc="left", fontweight="bold")


def _draw_inclusion(ax: Axes, weighed: Posterior) -> None:
    """The sum over all hypotheses that hold an effect, and what follows."""
    decision = decide(weighed)
    likely = [name for name in weighed.inclusion if name not in (NONE, UNKNOWN)][:INCLUDED]
    values = [weighed.inclusion[name] for name in likely]
    colours = [BLUE if name in decision.names else GREY for name in likely]
    _bars(ax, [words(name) for name in likely], values, colours)
    for y, value in enumerate(values):
        _at_end(ax, value, y)
    ax.set_ylim(INCLUDED + 2.0, -0.6)
    ax.vlines(SURE, -0.6, INCLUDED - 0.4, color=ORANGE)
    ax.annotate(f"SURE, {SURE:g}", (SURE, -0.75), ha="right", color=ORANGE, annotation_clip=False)
    ax.set(xlim=(0.0, 1.0), xlabel="inclusion probability of an effect")
    ax.set_title("3. Decision", loc="left", fontweight="bold")
    named = ", ".join(words(name) for name in decision.names)
    lines = (f"{decision.verdict}: {named}", decision.reason.partition("; ")[2])
    box = {"boxstyle": "round,pad=0.5", "fc": "white", "ec": BLUE}
    ax.annotate("\n".join(lines), (0.5, INCLUDED + 0.75), ha="center", va="center", bbox=box)


def _at_end(ax: Axes, value: float, y: float) -> None:
    """A bar's value: in its end where that is far out."""
    out = value > 0.8
    ax.annotate(
        f" {value:.3f} ",
        (min(value, SURE), y),
        va="center",
        ha="right" if out else "left",
        color="white" if out else "black",
    )


def _bars(ax: Axes, names: list[str], values: Any, colour: Any) -> None:
    """From the top down."""
    places = np.arange(len(names))
    ax.barh(places, values, color=colour, height=0.7)
    ax.set_yticks(places, names)
    ax.set_ylim(len(names) - 0.4, -0.6)
    ax.spines[["top", "right"]].set_visible(False)


def _named(names: Names) -> str:
    """A hypothesis in words."""
    return " with ".join(words(name) for name in names)


def write(path: Path) -> None:
    """Write the figure; the same bytes for the same picture."""
    with mpl.rc_context(SETTINGS):
        figure = drawn()
        figure.savefig(path, metadata={"Date": None, "Creator": None})
        plt.close(figure)


if __name__ == "__main__":
    write(PICTURE)
