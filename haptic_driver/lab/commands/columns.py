"""`--column NAME=COLUMN:UNIT`: what a table calls its columns, and in which unit they are."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from typer import Option

from haptic_driver.cli.output import stderr
from haptic_driver.errors import BadInputError

if TYPE_CHECKING:
    from haptic_driver.lab.raw_trials.folder import Cut
    from model.support.tables import Named

ColumnOption = Annotated[
    list[str] | None,
    Option(
        help="NAME=COLUMN or NAME=COLUMN:UNIT, as normal_force_n=Fz:mN; may be repeated.",
        metavar="NAME=COLUMN",
    ),
]

MapOption = Annotated[
    Path | None,
    Option("--map", help="Raw trial files are given, as this TOML says; see haptic rows."),
]


def refuse_both(map_file: Path | None, column: Sequence[str] | None) -> None:
    """BadInputError where both a map and columns are given."""
    if map_file is not None and column:
        said = "--map is for raw trial files, whose columns it names"
        raise BadInputError("usage", said, "Give trial files with --map, or tables with --column")


def tell_doubts(found: Cut) -> None:
    """Say what the trials leave in doubt, a line a kind."""
    for line in found.doubts_said():
        stderr.print(f"doubt: {line}")


def columns_named(
    given: Sequence[str] | None, known: Sequence[str], example: str
) -> Mapping[str, Named]:
    """What the options say, by our names.

    The unit is what follows the last colon, else what the column's own name says. BadInputError
    for a name that is not among `known`, and for a unit that is not one of that column.
    """
    from model.support.errors import nearest  # noqa: PLC0415
    from model.support.tables import Named  # noqa: PLC0415
    from model.support.units import to_column  # noqa: PLC0415

    found: dict[str, Named] = {}
    for said in given or ():
        ours, sign, theirs = said.partition("=")
        if not sign:
            hint = f"Give for example: --column {example}"
            raise BadInputError("bad_column", f"--column {said}: has no sign =", hint)
        if ours not in known:
            wrong = f"--column {ours}=...: not a column that is read"
            raise BadInputError("bad_column", wrong, nearest(ours, list(known)))
        if ours in found:
            raise BadInputError("bad_column", f"--column {ours}=... is given twice", "Give it once")
        column, colon, unit = theirs.rpartition(":")
        if colon:
            to_column(ours, unit, f"--column {said}")
            found[ours] = Named(column, unit)
        else:
            found[ours] = Named(theirs)
    return found
