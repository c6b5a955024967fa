"""`haptic datasheet`: what a rig does to friction, measured, on one page."""

from __future__ import annotations

import datetime
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Annotated

from rich.table import Table
from typer import Option

from haptic_driver.cli.output import (
    Json,
    ModelOption,
    RigOption,
    confirm_attended,
    progress,
    report,
    stderr,
    stdout,
)
from haptic_driver.errors import BadInputError
from haptic_driver.files import require_ending
from haptic_driver.lab.papers.write import ENDINGS, write
from haptic_driver.lookup.models import load_model
from haptic_driver.rig.config import RigConfig, load_rig
from model.description import ModelDescription

if TYPE_CHECKING:
    from haptic_driver.lab.papers.sheet_passes import Slider


def datasheet(
    out: Annotated[Path, Option(help="The sheet: a name in .pdf, .html or .json.")],
    rig: RigOption = "simulated",
    model: ModelOption = "reference",
    yes: Annotated[
        bool, Option("--yes", help="A real rig begins without asking; somebody is there.")
    ] = False,
    as_json: Json = False,
) -> None:
    """Measure a rig with a finger that slides, and write its data sheet of one page.

    The sheet has friction range and contrast over load and speed, and rise and fall. It has the
    latency from place to friction, with the position error that it makes. It also has bandwidth,
    repeatability, touch current and noise. Each comes with its interval and how it was got. A
    simulated finger slides in simulated time. On a real rig a person slides as prompted, pass by
    pass, on the running daemon. It renders without feedback meanwhile.

    Example: `haptic datasheet --rig simulated --out sheet.pdf`
    """
    require_ending(out, ENDINGS)
    config, description = load_rig(rig), load_model(model)
    from haptic_driver.lab.papers.data_sheet import (  # noqa: PLC0415  (slow to import)
        data_sheet,
        measure_sheet,
        pass_count,
        readable,
        sheet_facts,
    )

    with progress("sliding", pass_count()) as advance, _finger(config, description, yes) as finger:
        found = measure_sheet(finger, advance)
    facts = sheet_facts(found, config, description, datetime.date.today())
    paper = data_sheet(found, facts)
    write(paper, out)

    def show() -> None:
        table = Table("quantity", "value", "interval", title=paper.title, title_justify="left")
        for name, one in facts["numbers"].items():
            table.add_row(one["what"], *readable(name, one))
        stdout.print(table)
        stdout.print(f"sheet: {out}")

    report(as_json, {**facts, "out": str(out)}, show)


@contextmanager
def _finger(config: RigConfig, description: ModelDescription, yes: bool) -> Iterator[Slider]:
    """Who slides on a rig: a simulated finger, or a person at the daemon that has the rig."""
    from haptic_driver.lab.papers.sheet_passes import SimulatedSlider  # noqa: PLC0415

    if config.simulated:
        with SimulatedSlider(config, description) as finger:
            yield finger
        return
    from haptic_driver.client import LEASE_S, HapticClient  # noqa: PLC0415
    from haptic_driver.lab.papers.sheet_person import GuidedSlider  # noqa: PLC0415

    with HapticClient() as client, TemporaryDirectory(prefix="haptic-sheet-") as folder:
        status = client.status()
        if status.rig != config.name or status.model != description.name:
            said = f"the daemon has rig {status.rig} and model {status.model}"
            hint = f"Start it with rig {config.name}, then: haptic use {description.name}"
            raise BadInputError("another_rig", said, hint)
        stderr.print(
            f"rig {config.name} is real: a person slides, up to {config.limits.voltage_v:g} V peak."
        )
        if not yes:
            confirm_attended(config.name)
        client.use_model(name=status.model, feedback=False)
        try:
            with client.armed(LEASE_S, "haptic datasheet") as session:
                yield GuidedSlider(client, session, Path(folder), stderr.print)
        finally:
            client.use_model(name=status.model)
