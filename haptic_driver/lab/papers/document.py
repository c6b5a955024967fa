"""A paper as a list of blocks, which know nothing of pages."""

from __future__ import annotations

import io
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from haptic_driver.pictures.saving import draw_into, pyplot

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@dataclass(frozen=True)
class Heading:
    """What follows belongs together."""

    text: str


@dataclass(frozen=True)
class Paragraph:
    """Text over the whole width; `small` where it is a note."""

    text: str
    small: bool = False


@dataclass(frozen=True)
class Table:
    """`widths` are shares of the line, one per column. `row_mm` is the least height of a row."""

    header: Sequence[str]
    rows: Sequence[Sequence[str]]
    widths: Sequence[float]
    row_mm: float = 0.0


@dataclass(frozen=True)
class Figure:
    """`draw` is given as many axes, side by side, as `panels` says."""

    draw: Callable[[Sequence[Axes]], None]
    height_mm: float
    caption: str
    panels: int = 1


Block = Heading | Paragraph | Table | Figure


@dataclass(frozen=True)
class Document:
    """`about` stands below the title, `foot` below every page; `facts` is what JSON holds."""

    title: str
    about: str
    foot: str
    blocks: Sequence[Block]
    facts: Mapping[str, Any]


def picture(figure: Figure, kind: str) -> bytes:
    """A figure as the content of a file of that kind, such as png."""
    plt = pyplot()
    size = (7.0, figure.height_mm / 25.4)
    drawn, axes = plt.subplots(1, figure.panels, figsize=size, squeeze=False, layout="constrained")
    try:
        figure.draw(axes[0])
        written = io.BytesIO()
        draw_into(drawn, written, kind, dpi=300)
    finally:
        plt.close(drawn)
    return written.getvalue()
