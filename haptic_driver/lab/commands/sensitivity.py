"""`haptic sensitivity`: which uncertain number matters where, and what drives beyond the sine
do.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import numpy as np
from rich.table import Table
from typer import Option

from haptic_driver.cli.output import Json, ModelOption, report, status, stdout
from haptic_driver.errors import BadInputError
from haptic_driver.files import write_rows
from haptic_driver.lab.pictures.model import draw_sensitivity
from haptic_driver.lookup.models import load_model
from model.analysis.sensitivity import force_sensitivity
from model.conditions import Conditions

FREQUENCIES_HZ = (10.0, 250.0, 1e4)


def sensitivity(
    out: Annotated[Path, Option(help="Folder for the picture and the table.")] = Path(
        "sensitivity"
    ),
    model: ModelOption = "reference",
    frequency: Annotated[
        list[float] | None, Option(help="Hz; repeatable. Default: 10, 250 and 10000.")
    ] = None,
    voltage: Annotated[float, Option(help="V peak at the electrode.", min=1.0)] = 75.0,
    normal_force: Annotated[float, Option(help="N.", min=0.01)] = 0.5,
    draws: Annotated[int, Option(help="Per matrix; a power of two.", min=64, max=65536)] = 1024,
    seed: Annotated[int, Option(min=0)] = 0,
    as_json: Json = False,
) -> None:
    """Say how much each uncertain number adds to the spread of the electrostatic force (Sobol
    indices).

    Example: `haptic sensitivity --out sensitivity`
    """
    if draws & (draws - 1):
        raise BadInputError(
            "bad_draws", f"--draws {draws} is not a power of two", "For example 1024"
        )
    at = np.array(frequency or FREQUENCIES_HZ)
    conditions = Conditions(at, np.full(at.size, voltage), np.full(at.size, normal_force))
    with status("drawing"):
        found = force_sensitivity(load_model(model), conditions, draws, seed)
    picture, table = out / "sensitivity.png", out / "sensitivity.csv"
    draw_sensitivity(found, picture)
    entries: list[dict[str, str | float]] = [
        {"condition": c, "name": n, "first_order": float(first), "total": float(total)}
        for c, firsts, totals in zip(found.conditions, found.first, found.total, strict=True)
        for n, first, total in zip(found.names, firsts, totals, strict=True)
    ]
    write_rows(table, entries)
    payload = {
        "picture": str(picture),
        "table": str(table),
        "relative_std": dict(zip(found.conditions, found.relative_std.tolist(), strict=True)),
        "indices": entries,
        "seed": seed,
    }

    def show() -> None:
        title = f"total Sobol index of the force at {voltage:g} V, {normal_force:g} N"
        shown = Table("parameter", *(f"{f:g} Hz" for f in at), box=None, title=title)
        for i in np.argsort(-found.total.max(axis=0)):
            shown.add_row(found.names[i], *(f"{x:.3f}" for x in found.total[:, i]))
        shown.add_row("std of log(force)", *(f"{x:.2f}" for x in found.relative_std))
        stdout.print(shown)
        stdout.print(f"picture: {picture}, table: {table}")

    report(as_json, payload, show)
