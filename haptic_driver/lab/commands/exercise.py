"""`haptic exercise`: sealed rigs and data for a course, and the marks of the answers."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table
from typer import Argument, Option

from haptic_driver.cli.output import Json, named, progress, report, stdout

app = typer.Typer(no_args_is_help=True)
Folder = Annotated[Path, Argument(metavar="DIR", help="Folder of the course.")]


@app.command()
def make(
    folder: Folder,
    seed: Annotated[
        int, Option(min=0, help="Of everything that is drawn; nobody else should guess it.")
    ],
    students: Annotated[int, Option(min=1, max=999, help="How many.")] = 20,
    plan: Annotated[str, named("plans", "Plan of the data")] = "course",
    as_json: Json = False,
) -> None:
    """Write a rig, data and a task for each student, and a key for the lecturer alone.

    Each finger differs, and has one effect that the model lacks, or none. The rig's file holds it
    sealed: it hides from looking, not from whoever writes a program to open it. A student takes
    some ten seconds.

    Example: `haptic exercise make out/course --seed 271828 --students 20`
    """
    from haptic_driver.lab.exercises import make as make_all  # noqa: PLC0415

    with progress("students", students) as advance:
        key = make_all(folder, (seed, students, plan), advance)
    payload = {"folder": str(folder), "students": list(key.students)}
    said = f"{students} folders in {folder / 'students'}; keep {folder / 'key.json'} to yourself"
    report(as_json, payload, lambda: stdout.print(said))


@app.command()
def score(
    folder: Folder,
    answers: Annotated[list[Path], Argument(help="JSON, as the tasks show; one file or many.")],
    as_json: Json = False,
) -> None:
    """Mark answers by the lecturer's key and the rules of `haptic challenge`.

    Example: `haptic exercise score out/course answers/*.json`
    """
    from haptic_driver.lab.exercises import marks, read_key  # noqa: PLC0415

    found, total, left_out = marks(read_key(folder), answers)
    right = sum(mark.right for mark in found.values())
    payload = {
        "students": {
            name: mark._asdict() | {"answer": mark.answer.model_dump(exclude_defaults=True)}
            for name, mark in found.items()
        },
        "right": right,
        "total": total,
        "left_out": left_out,
    }

    def show() -> None:
        table = Table("student", "hidden", "answer", "mark")
        for name, mark in found.items():
            verdict, effects = mark.answer.verdict or "-", ", ".join(mark.answer.effects)
            hidden = ", ".join(mark.hidden) or "nothing"
            table.add_row(name, hidden, f"{verdict} {effects}".strip(), mark.mark)
        stdout.print(table)
        for said in left_out:
            stdout.print(f"left out: {said}")
        wrong = total["names"]["wrong_name"]["count"]
        stdout.print(f"right {right} of {len(found)}; wrong names {wrong}")

    report(as_json, payload, show)
