"""Psychometric functions with the answers that they were fitted to."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from haptic_driver.pictures.saving import pyplot, saved
from haptic_driver.signals import Array

ANSWERS, FUNCTION = "#1b6ca8", "#3a3a3a"
LARGEST_DOT = 120.0
CLASSES = 12  # of levels of an adaptive method, each one dot


class Answers(NamedTuple):
    """What a panel shows: `positive` of `answered` answers at `levels` [n], and, where it was
    fitted, the function, its threshold and that one's interval. `said` takes the place of a
    threshold that there is none of: NaN. `axis`: what a level is. `courses`: of each session levels
    and positive answers, trial by trial.
    """

    title: str
    levels: Array
    positive: Array
    answered: Array
    function: Callable[[Array], Array] | None = None
    threshold: float = np.nan
    interval: tuple[float, float] = (np.nan, np.nan)
    said: str = ""
    axis: str = "level"
    courses: Sequence[tuple[Sequence[float], Sequence[bool]]] = ()


class Threshold(NamedTuple):
    """Of one participant, or of their mean, with its 95 % interval."""

    name: str
    value: float
    interval: tuple[float, float]


def draw_functions(panels: Sequence[Answers], title: str, path: Path) -> None:
    """One panel each: shares of positive answers, by area as many as they stand for, function and
    threshold.
    """
    with _panels(len(panels), title, path) as places:
        for axes, panel in zip(places, panels, strict=True):
            axes.set(title=panel.title, xlabel=panel.axis, ylim=(-0.03, 1.03))
            axes.set_ylabel("share of positive answers")
            _draw(axes, panel)


def draw_levels(panels: Sequence[Answers], title: str, path: Path) -> None:
    """One panel each: levels over trials, filled where the answer was positive, and the
    threshold.
    """
    with _panels(len(panels), title, path) as places:
        for axes, panel in zip(places, panels, strict=True):
            axes.set(title=panel.title, xlabel="delivered trial", ylabel=panel.axis)
            begun = 1
            for levels, positive in panel.courses:
                trial = np.arange(begun, begun + len(levels))
                axes.plot(trial, levels, color=FUNCTION, lw=0.8)
                faces = [ANSWERS if yes else "white" for yes in positive]
                axes.scatter(trial, levels, s=22, c=faces, edgecolors=ANSWERS, lw=0.9, zorder=3)
                begun += len(levels)
            if np.isfinite(panel.threshold):
                axes.axhline(panel.threshold, color=FUNCTION, ls=":", lw=1.0, label="threshold")
                axes.legend(frameon=False, loc="best", fontsize=8)


def draw_thresholds(rows: Sequence[Threshold], title: str, axis: str, path: Path) -> None:
    """A line for each with its interval, as far as the axis goes; the last is their mean."""
    ends = np.array([row.interval for row in rows])
    known = [*(row.value for row in rows), *ends[np.isfinite(ends)]]
    with _panels(1, title, path) as (axes,):
        for y, row in enumerate(rows):
            color = FUNCTION if y == len(rows) - 1 else ANSWERS
            shown = np.clip(row.interval, min(known), max(known))
            axes.plot(shown, [y, y], color=color, lw=2, alpha=0.5)
            axes.plot([row.value], [y], "o", color=color)
        axes.set(xlabel=axis, yticks=range(len(rows)), yticklabels=[row.name for row in rows])
        axes.invert_yaxis()


@contextmanager
def _panels(count: int, title: str, path: Path) -> Iterator[list[Any]]:
    """Axes in rows of three, of a picture that is then written."""
    columns = min(count, 3)
    rows = -(-count // columns)
    figure, places = pyplot().subplots(
        rows, columns, figsize=(4.0 * columns, 3.4 * rows), squeeze=False, layout="constrained"
    )
    with saved(figure, path):
        for axes in places.flat:
            axes.grid(alpha=0.25)
        for axes in places.flat[count:]:
            axes.set_visible(False)
        yield list(places.flat[:count])
        figure.suptitle(title)


def _draw(axes: Any, panel: Answers) -> None:
    if panel.function is None:
        axes.text(
            0.5, 0.5, panel.said, ha="center", va="center", wrap=True, transform=axes.transAxes
        )
        return
    level, share, count = _classes(panel)
    axes.scatter(
        level,
        share,
        s=LARGEST_DOT * count / count.max(),
        color=ANSWERS,
        alpha=0.6,
        lw=0,
        label="answers",
    )
    margin = 0.05 * float(np.ptp(panel.levels))
    x = np.linspace(panel.levels[0] - margin, panel.levels[-1] + margin, 200)
    axes.plot(x, panel.function(x), color=FUNCTION, lw=1.5, label="fitted")
    if np.isnan(panel.threshold):
        axes.text(0.5, 0.03, panel.said, ha="center", wrap=True, transform=axes.transAxes)
        axes.legend(frameon=False, loc="best", fontsize=8)
        return
    at = float(panel.function(np.array([panel.threshold]))[0])
    shown = np.clip(panel.interval, x[0], x[-1])
    axes.plot(shown, [at, at], color=FUNCTION, lw=3, alpha=0.5, label="threshold, 95 %")
    for end, there, marker in zip(panel.interval, shown, "<>", strict=True):
        if end != there:  # it goes on beyond the axis
            axes.plot([there], [at], marker, color=FUNCTION, ms=9, clip_on=False)
    axes.plot([panel.threshold, panel.threshold], [0.0, at], color=FUNCTION, lw=1.0, ls=":")
    axes.legend(frameon=False, loc="lower right", fontsize=8)


def _classes(panel: Answers) -> tuple[Array, Array, Array]:
    """Levels, shares and numbers of answers; many levels are put together into classes with as many
    answers each.
    """
    if panel.levels.size <= CLASSES:
        return panel.levels, panel.positive / panel.answered, panel.answered
    done = np.cumsum(panel.answered) - 0.5 * panel.answered
    number = np.minimum((done / panel.answered.sum() * CLASSES).astype(int), CLASSES - 1)
    total = [
        np.bincount(number, weights=w)
        for w in (panel.levels * panel.answered, panel.positive, panel.answered)
    ]
    level, positive, count = (np.asarray(values[total[2] > 0.0], np.float64) for values in total)
    return level / count, positive / count, count
