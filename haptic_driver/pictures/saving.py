"""How pictures are made: without a window, and saved as a whole or with an error that says why
not.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

from haptic_driver.errors import shown
from haptic_driver.files import replacing, require_ending

if TYPE_CHECKING:
    from matplotlib.figure import Figure

CANVASES = {
    "png": ("agg", "FigureCanvasAgg"),
    "pdf": ("pdf", "FigureCanvasPdf"),
    "svg": ("svg", "FigureCanvasSVG"),
}
ENDINGS = tuple(f".{kind}" for kind in CANVASES)


def pyplot() -> Any:
    """Matplotlib without a window. It is slow to import: only who draws waits for it."""
    import matplotlib as mpl  # noqa: PLC0415

    mpl.use("Agg")
    import matplotlib.pyplot as plt  # noqa: PLC0415

    return plt


def _show_as_it_stands(figure: Figure) -> None:
    """Names and labels are text: a $ in one begins no formula, and what does not print is escaped.

    Labels of ticks stay as they are, since those of logarithmic axes are formulas of matplotlib's.
    """
    from matplotlib.text import Text  # noqa: PLC0415  (slow to import)

    ticks = {
        label
        for axes in figure.axes
        for axis in (axes.xaxis, axes.yaxis)
        for label in (*axis.get_majorticklabels(), *axis.get_minorticklabels())
    }
    for text in figure.findobj(Text):
        if isinstance(text, Text) and text not in ticks:
            text.set_parse_math(False)
            text.set_text(shown(text.get_text(), lines=True))


def draw_into(
    figure: Figure,
    to: Path | IO[bytes],
    kind: str,
    dpi: int,
    metadata: dict[str, str | None] | None = None,
) -> None:
    """Draw `figure` into a file of that kind: png, pdf or svg.

    Not by `savefig`, which draws everything twice, the first time for the layout alone.
    """
    module, name = CANVASES[kind]
    canvas = getattr(import_module(f"matplotlib.backends.backend_{module}"), name)
    figure.set_dpi(dpi)
    getattr(canvas(figure), f"print_{kind}")(to, metadata=metadata)


@contextmanager
def saved(figure: Figure, path: Path, dpi: int = 110) -> Iterator[None]:
    """Save `figure` at the end of the block, as the ending of `path` says, and close it however the
    block ends.
    """
    try:
        require_ending(path, ENDINGS)
        yield
        _show_as_it_stands(figure)
        with replacing(path) as part:
            draw_into(figure, part, path.suffix[1:].lower(), dpi)
    finally:
        pyplot().close(figure)
