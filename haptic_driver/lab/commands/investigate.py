"""`haptic investigate`: measure, diagnose and measure again, until a name is earned."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table
from typer import Option

from haptic_driver.cli.output import (
    Json,
    ModelOption,
    RigOption,
    confirm_attended,
    named,
    report,
    status,
    stderr,
    stdout,
)
from haptic_driver.errors import BadInputError, HapticError
from haptic_driver.files import bad_input
from haptic_driver.lab.measuring.investigate import Budget, Investigation, Subject
from haptic_driver.lab.measuring.investigate import investigate as run
from haptic_driver.lab.measuring.plan import load_plan
from haptic_driver.lookup.models import load_model
from haptic_driver.rig.config import load_rig
from haptic_driver.simulation.finger_function import load_finger

SAID = {
    "named": "a name is earned",
    "nothing_missing": "nothing is missing from the model",
    "cannot_be_told_apart": "nothing that this rig may do could tell the rest apart",
    "unexplained": "no effect of the catalogue explains it",
    "budget_spent": "the budget is spent",
}


def investigate(
    rig: RigOption = "simulated",
    model: ModelOption = "reference",
    out: Annotated[
        Path, Option(help="Folder: one per round in it, and investigation.json.")
    ] = Path("investigation"),
    plan: Annotated[str, named("plans", "Plan of the first round")] = "witnesses",
    rounds: Annotated[int, Option(min=1, max=20, help="At most so many.")] = 4,
    minutes: Annotated[float, Option(min=1.0, help="Of measuring, at most.")] = 60.0,
    finger: Annotated[
        str | None, Option(help="module:function, all that the simulated finger does.")
    ] = None,
    seed: Annotated[int, Option(min=0, help="Order and noise.")] = 0,
    yes: Annotated[
        bool, Option("--yes", help="A real rig begins without asking; somebody is there.")
    ] = False,
    as_json: Json = False,
) -> None:
    """Measure, diagnose, propose and measure again, until the missing effect has a name.

    It ends when a name is earned, when nothing that this rig may do could tell the rest apart, or
    when the budget is spent. Every round measures what separates the leading explanations soonest.
    It reads friction and spectra of the electrode's current, and the same after an intervention,
    such as wiping the finger. A person at a real rig is asked; a simulated rig does it. What lies
    in the folder already is not measured again.

    Example: `haptic investigate --rig hidden_humidity --model reference --out investigation`
    """
    config, description = load_rig(rig), load_model(model)
    if finger is not None and not config.simulated:
        raise BadInputError(
            "usage", f"rig {config.name} is real: it has its own finger", "Leave --finger out"
        )
    if not (config.simulated or yes):
        stderr.print(
            f"rig {config.name} is real: the stage moves, the screen is energised, for at most"
            f" {minutes:g} min"
        )
        confirm_attended(config.name)
    function = None if finger is None else load_finger(finger)
    subject = Subject(config, description, load_plan(plan), function, seed, _ask)
    with bad_input("bad_data"), status("investigating") as tell:
        try:
            found = run(subject, out, Budget(rounds, minutes), tell)
        except KeyboardInterrupt as stop:
            said = f"interrupted; what is measured so far is in {out}"
            raise HapticError("interrupted", said, "The same command goes on from there") from stop
    report(as_json, found.payload(), lambda: _show(found, out))


def _ask(todo: str) -> bool:
    """Whether a person has done it; without a terminal nobody has."""
    return sys.stdin.isatty() and typer.confirm(f"Please {todo}. Done (y), or skip (n)?", err=True)


def _show(found: Investigation, out: Path) -> None:
    diagnosis = found.diagnosis
    names = ", ".join(effect["name"] for effect in diagnosis["effects"]) or "no name"
    stdout.print(f"{found.outcome}: {SAID[found.outcome]} ({names})")
    table = Table("round", "verdict", "suspects", "then proposed")
    for told in found.history:
        proposals = told["proposals"]
        done = sorted({p["setting"]["intervention"] for p in proposals} - {"none"})
        what = f"{sum(p['settings'] for p in proposals)} settings" + (
            f", after {', '.join(done)}" if done else ""
        )
        table.add_row(
            str(told["round"]),
            told["verdict"],
            ", ".join(told["suspects"]),
            what if proposals else "nothing",
        )
    if found.history:
        stdout.print(table)
    stdout.print(
        f"{found.rows} rows in {found.rounds} rounds, {found.measured_s / 60.0:.0f} min of"
        " measuring"
    )
    stdout.print(
        f"report: {out / f'round-{found.rounds}' / 'report.html'}; model: {diagnosis['model']}",
        soft_wrap=True,
    )
    if found.outcome == "budget_spent":
        stderr.print("give more --rounds or --minutes and the same --out to go on")
