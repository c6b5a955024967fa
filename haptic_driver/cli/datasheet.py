"""`haptic datasheet`: what a rig does to friction, measured, on one page."""

from __future__ import annotations

import datetime
from pathlib import Path
from typing import Annotated

from rich.table import Table
from typer import Option

from haptic_driver.cli.output import Json, ModelOption, RigOption, progress, report, stdout
from haptic_driver.errors import BadInputError
from haptic_driver.papers.document import check_ending, write
from haptic_driver.rig.config import load_rig
from haptic_driver.surface.models import load_model


def datasheet(
    out: Annotated[Path, Option(help="The sheet: a name in .pdf, .html or .json.")],
    rig: RigOption = "simulated",
    model: ModelOption = "reference",
    as_json: Json = False,
) -> None:
    """Measure a rig with a finger that slides, and write its data sheet of one page.

    Friction range and contrast over load and speed, rise and fall, latency from place to friction
    and the position error that it makes, bandwidth, repeatability, touch current, noise; each with
    its interval and how it was got. A simulated finger slides in simulated time.

    Example: `haptic datasheet --rig simulated --out sheet.pdf`
    """
    check_ending(out)
    config, description = load_rig(rig), load_model(model)
    if not config.simulated:
        raise BadInputError(
            "not_simulated",
            f"rig {config.name} is not simulated",
            "haptic datasheet energises no hardware yet",
        )
    from haptic_driver.papers.data_sheet import (  # noqa: PLC0415  (slow to import)
        data_sheet,
        measure_sheet,
        pass_count,
        sheet_facts,
    )
    from haptic_driver.papers.sheet_passes import SimulatedSlider  # noqa: PLC0415

    with (
        progress("sliding", pass_count()) as advance,
        SimulatedSlider(config, description) as finger,
    ):
        found = measure_sheet(finger, advance)
    facts = sheet_facts(found, config, description, datetime.date.today())
    paper = data_sheet(found, facts)
    write(paper, out)

    def show() -> None:
        table = Table("quantity", "value", title=paper.title, title_justify="left")
        for one in facts["numbers"].values():
            value = "not known" if one["value"] is None else f"{one['value']:.3g} {one['unit']}"
            table.add_row(one["what"], value)
        stdout.print(table)
        stdout.print(f"sheet: {out}")

    report(as_json, {**facts, "out": str(out)}, show)
