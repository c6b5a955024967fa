"""`haptic study`: many fingers, their surfaces, and how friction spreads over them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from rich.table import Table
from typer import Argument, Option

from haptic_driver.cli.output import Json, named, progress, report, stderr, stdout
from haptic_driver.lab.pictures.model import draw_study


def study(
    plan: Annotated[str, named("populations", "Study", Argument)],
    out: Annotated[Path, Option(help="Folder of results; a study stopped there goes on.")] = Path(
        "study"
    ),
    cluster: Annotated[
        str | None, Option(help="Scheduler of a Dask cluster, for example tcp://127.0.0.1:8786.")
    ] = None,
    workers: Annotated[int | None, Option(help="Processes on this machine.", min=1)] = None,
    as_json: Json = False,
) -> None:
    """Solve a surface for every finger of a study and say how friction, force and reach spread over
    them.

    Stop it at any time: the same command goes on where it stopped. On a cluster the results are the
    same; surfaces are kept only on one machine.

    Example: `haptic study fingers --out study`
    """
    from haptic_driver.lab.studies import load_study, run_study, statistics  # noqa: PLC0415

    found = load_study(plan)
    with progress("fingers", found.plan.count) as advance:
        where: dict[str, Any] = {"cluster": cluster, "workers": workers}
        results = run_study(found, out, **where, advance=advance, tell=stderr.print)
    spread = statistics(found, results)
    (out / "statistics.json").write_text(json.dumps(spread, indent=1) + "\n", encoding="utf-8")
    pictures = []
    for i, combination in enumerate(found.plan.combinations):
        own = results[i :: len(found.plan.combinations)]
        picture = out / (
            f"spread-{i + 1}.png" if len(found.plan.combinations) > 1 else "spread.png"
        )
        reach = np.array([[r["reachable_low"], r["reachable_high"]] for r in own])
        about = (
            f"{found.plan.fingers} fingers under {found.plan.at.normal_force_n:g}"
            f" N{_said(combination)}"
        )
        draw_study(
            found.frequency_hz, np.array([r["highest_cof"] for r in own]), reach, about, picture
        )
        pictures.append(str(picture))
    payload = {
        "study": found.plan.name,
        "hash": found.content_hash,
        "tasks": len(results),
        "out": str(out),
        "statistics": spread,
        "pictures": pictures,
    }
    report(as_json, payload, lambda: _show(spread, [str(out), *pictures]))


def _said(combination: dict[str, float]) -> str:
    return "".join(f", {name} {value:g}" for name, value in combination.items())


def _show(spread: list[dict[str, Any]], written: list[str]) -> None:
    for entry in spread:
        table = Table(
            "",
            "5 %",
            "25 %",
            "median",
            "75 %",
            "95 %",
            box=None,
            title=_said(entry["levels"])[2:] or None,
        )
        for name, values in entry.items():
            if name != "levels":
                shown = (
                    "-" if v is None else f"{v:.4g}" for k, v in values.items() if k != "count"
                )
                table.add_row(name, *shown)
        stdout.print(table)
    stdout.print(f"results: {', '.join(written)}")
