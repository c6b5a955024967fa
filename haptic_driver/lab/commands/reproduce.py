"""`haptic reproduce`: the paper's figures 4 to 8, by the corrected and by the printed equations."""

from __future__ import annotations

import math
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

from rich.table import Table
from typer import Option

from haptic_driver.cli.output import Json, ModelOption, report, status, stdout
from haptic_driver.files import writing
from haptic_driver.lookup.models import load_model


def reproduce(
    figure: Annotated[
        int | None, Option(min=4, max=8, help="One figure; all when left out.")
    ] = None,
    out: Annotated[Path, Option(help="Folder for the pictures and tables.")] = Path("reproduction"),
    model: ModelOption = "reference",
    as_json: Json = False,
) -> None:
    """Compute figures 4 to 8 of the paper: pictures, CSV tables, and its statements beside what
    comes out.

    Every figure shows the corrected equations and those printed. Measured curves are not drawn:
    their numbers are not printed.

    Example: `haptic reproduce --figure 7 --out out`
    """
    # matplotlib is slow to import
    from haptic_driver.lab.figures.reproduce import FIGURES  # noqa: PLC0415
    from haptic_driver.lab.figures.reproduce import reproduce as run  # noqa: PLC0415

    description = load_model(model)
    wanted = [*FIGURES] if figure is None else [figure]
    with writing(out), status("reproducing") as tell:
        files, facts = run(description, wanted, out, tell)
    payload = {
        "model": description.name,
        "files": [str(f) for f in files],
        "facts": [asdict(f) for f in facts],
    }

    def show() -> None:
        if facts:
            table = Table("figure", "the text states", "number", "corrected", "as printed")
            for f in facts:
                table.add_row(
                    f.figure,
                    f.statement,
                    f.quantity,
                    _answer(f.corrected, f.corrected_holds),
                    _answer(f.published, f.published_holds),
                )
            stdout.print(table)
        for file in files:
            stdout.print(str(file))

    report(as_json, payload, show)


def _answer(number: float, holds: bool) -> str:
    if math.isnan(number):
        return "no answer"
    return f"{number:.3g} ({'holds' if holds else 'does not hold'})"
