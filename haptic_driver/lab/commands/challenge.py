"""`haptic challenge`: sets of data with hidden effects, answers to them, and their scores."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer
from rich.table import Table
from typer import Argument, Option

from haptic_driver.cli.output import Json, progress, report, stdout

app = typer.Typer(no_args_is_help=True)
Folder = Annotated[Path, Argument(metavar="DIR", help="Folder of the challenge.")]


@app.command()
def make(
    folder: Folder,
    seed: Annotated[int, Option(min=0, help="Of everything that is drawn.")],
    sets: Annotated[int, Option(min=1, max=999, help="How many sets.")] = 24,
    friction: Annotated[
        bool, Option("--friction", help="Friction alone, in all sets instead of every other.")
    ] = False,
    as_json: Json = False,
) -> None:
    """Write sets of measured data in which effects may be hidden, and a data sheet; no label.

    A set takes a few seconds.

    Example: `haptic challenge make out/challenge --seed 1`
    """
    from haptic_driver.lab.challenge.sets import make as make_sets  # noqa: PLC0415

    with progress("sets", sets) as advance:
        made = make_sets(folder, (seed, sets, friction), advance)
    payload = {"folder": str(folder), "sets": list(made.files)}
    said = f"{sets} sets in {folder / 'sets'}; read {folder / 'README.md'}"
    report(as_json, payload, lambda: stdout.print(said))


@app.command()
def answer(
    folder: Folder,
    out: Annotated[Path, Option(help="JSON to write.")] = Path("answers.json"),
    method: Annotated[
        str, Option(help="diagnosis, base (nothing is ever missing), aicc, bic or regions.")
    ] = "diagnosis",
    as_json: Json = False,
) -> None:
    """Answer a challenge by diagnoses, as `haptic diagnose` makes them, or by a simpler method.

    A set takes about a minute. What is answered is on the disk, and is not asked again.

    Example: `haptic challenge answer out/challenge --out out/answers.json`
    """
    from haptic_driver.lab.challenge import own  # noqa: PLC0415
    from haptic_driver.lab.challenge.answers import read_answers  # noqa: PLC0415
    from haptic_driver.lab.challenge.sets import columns_of, read_about, unseen_of  # noqa: PLC0415

    about = read_about(folder)
    found = read_answers(out, columns_of(folder, about)) if out.exists() else {}
    kept = len(found)
    with progress("diagnoses", len(about.files)) as advance:
        for i, name in enumerate(about.files):
            if name not in found:
                path = folder / "sets" / name
                unseen = own.read_unseen(unseen_of(path))
                found[name] = own.own_answer(path, method, unseen)
                own.write_answers(out, found)
            advance(i + 1)
    payload = {"out": str(out), "answers": len(found), "kept": kept}
    said = f"{len(found)} answers in {out}, {kept} of them as they were there"
    report(as_json, payload, lambda: stdout.print(said))


@app.command()
def score(
    folder: Folder,
    answers: Annotated[Path, Argument(help="JSON, as README.md of the challenge shows.")],
    as_json: Json = False,
) -> None:
    """Score answers by what was hidden, which is made again from the seed.

    Takes as long as making the sets.

    Example: `haptic challenge score out/challenge out/answers.json`
    """
    from haptic_driver.lab.challenge.answers import read_answers  # noqa: PLC0415
    from haptic_driver.lab.challenge.scores import scores  # noqa: PLC0415
    from haptic_driver.lab.challenge.sets import columns_of, read_about, truths  # noqa: PLC0415

    about = read_about(folder)
    given = read_answers(answers, columns_of(folder, about))
    with progress("sets", len(about.files)) as advance:
        found = scores(given, truths(about, advance))
    report(as_json, found, lambda: _show(found))


def _show(found: dict[str, Any]) -> None:
    from haptic_driver.lab.challenge.scores import RATES  # noqa: PLC0415

    table = Table("score", "", "of sets")
    for rate in RATES:
        count, of = found["names"][rate.key].values()
        table.add_row(rate.said, f"{count}" if of else "-", str(of))
    place, strength, finger, calibration = (
        found[part] for part in ("place", "strength", "finger", "calibration")
    )
    table.add_row("place, F1 over rows", _number(place["f1"]), str(place["sets"]))
    count, of = place["invented"].values()
    table.add_row("a place where no row is changed", f"{count}" if of else "-", str(of))
    off = strength["factor_off"]
    table.add_row("strength, median factor off", _number(off), str(strength["sets"]))
    proof = found["proof"]
    said = "settings not measured, median relative error"
    table.add_row(said, _number(proof["error"]), str(proof["sets"]))
    said = "the same, share of a visible change"
    table.add_row(said, _number(proof["share"]), str(proof["visible"]))
    off, (count, of) = finger["off_std"], finger["beyond_two"].values()
    table.add_row("finger's own numbers, median deviations off", _number(off), "")
    table.add_row("the same, beyond two, of numbers", f"{count}" if of else "-", str(of))
    said = f"{_number(calibration['error'])} (by chance {_number(calibration['by_chance'])})"
    table.add_row("stated probability, off in the mean", said, str(calibration["sets"]))
    stdout.print(table)
    answered = ", ".join(f"{part} {count}" for part, count in found["answered"].items())
    stdout.print(f"answered of {found['sets']} sets: {answered}")


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.3g}"
