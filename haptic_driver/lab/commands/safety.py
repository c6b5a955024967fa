"""`haptic safety`: what an ethics board asks about a rig."""

from __future__ import annotations

import datetime
from pathlib import Path
from typing import Annotated

from typer import Option

from haptic_driver.cli.output import Json, ModelOption, RigOption, report, stdout
from haptic_driver.files import require_ending
from haptic_driver.lab.papers.write import ENDINGS, write


def safety(
    out: Annotated[Path, Option(help="The report: a name in .pdf, .html or .json.")],
    rig: RigOption = "simulated",
    model: ModelOption = "reference",
    participants: Annotated[
        Path | None,
        Option(help="Participant information and consent to complete; likewise .pdf or .html."),
    ] = None,
    as_json: Json = False,
) -> None:
    """Write a rig's inspection report: hazards, limits, currents, failures, what is unverified.

    It is made from the rig's file, and opens no instrument. Currents are those of the model. It
    names standards and claims conformity with none. With `--json` its facts are printed as well.

    Example: `haptic safety --rig paper --out safety.pdf`
    """
    for path in (out, participants or out):
        require_ending(path, ENDINGS)
    from haptic_driver.lab.papers.participants import participant_information  # noqa: PLC0415
    from haptic_driver.lab.papers.safety import safety_file  # noqa: PLC0415  (slow to import)
    from haptic_driver.lab.papers.safety_facts import inspect  # noqa: PLC0415

    seen = inspect(rig, model, datetime.date.today())
    paper = safety_file(seen)
    write(paper, out)
    if participants is not None:
        write(participant_information(seen), participants)

    def show() -> None:
        worst = max(paper.facts["touch_currents"], key=lambda one: one["share"])
        stdout.print(
            f"rig {paper.facts['rig']}: worst-case current up to {worst['share']:.0%} of the file's"
            f" curve, at {worst['frequency_hz']:g} Hz and {worst['voltage_v']:.3g} V peak"
        )
        stdout.print(f"this holds for {paper.facts['limits']['current_holds_for']}")
        missing = paper.facts["refuses_to_come_on"]
        if missing:
            stdout.print(f"it refuses to come on without: {'; '.join(missing)}")
        stdout.print(f"report: {out}")
        if participants is not None:
            stdout.print(f"for participants, to be completed: {participants}")

    report(as_json, {**paper.facts, "out": str(out)}, show)
