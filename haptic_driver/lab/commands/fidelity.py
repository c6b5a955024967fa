"""`haptic fidelity`: how well felt friction met what was asked, in a recording or in any table."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import numpy as np
from typer import Argument, Option

from haptic_driver.cli.output import Json, report, stdout
from haptic_driver.errors import BadInputError
from haptic_driver.fidelity.measure import Fidelity, fidelity_of
from haptic_driver.fidelity.perception import Perception, load_perception
from haptic_driver.fidelity.said import said
from haptic_driver.fidelity.samples import fidelity_of_samples
from haptic_driver.fidelity.strokes import Stroke
from haptic_driver.lab.commands.columns import ColumnOption, columns_named
from haptic_driver.recording.event import Event
from haptic_driver.recording.read import read_run
from haptic_driver.signals import Array
from model.support.cells import number
from model.support.tables import Named, read_table

TIME, ASKED, FELT = "time_s", "target_cof", "measured_cof"
WANTED = (
    f"Give a recording, a CSV with columns {TIME}, {ASKED} and {FELT} (or --column), or with"
    " --asked two files of two columns: time and friction"
)
GAP_TICKS = 3.0  # between rows: what lies in a longer one is unknown
RECORDINGS = (".h5", ".hdf5")


def fidelity(
    file: Annotated[Path, Argument(help="Recording, or a CSV of what was felt.")],
    asked: Annotated[
        Path | None, Option(help="What was asked, where that is a file of its own.")
    ] = None,
    run: Annotated[str | None, Option(help="Run of a recording: 3, or run_0003.")] = None,
    column: ColumnOption = None,
    as_json: Json = False,
) -> None:
    """Compare felt with asked friction, by the measure of daemon, demo and page.

    A recording has all that it needs. A table needs time, asked and felt friction. Two files, such
    as somebody else's data, have a time and a friction each; what was asked is taken on a line
    between its rows. A table tells of friction alone, so what a finger feels of it is for a load of
    1 N.

    A texture with a `perceptual_gain` is compared as it was asked for, amplified. Its name and gain
    are told.

    Example: `haptic fidelity run.h5`
    """
    perception, gains = load_perception(), dict[str, float]()
    if file.suffix in RECORDINGS:
        if asked is not None or column:
            raise BadInputError("usage", "a recording has its columns", "Give the file alone")
        whole = read_run(file, run)
        found = fidelity_of_samples(whole.samples, perception)
        gains = _amplified(whole.events)
    else:
        if run is not None:
            raise BadInputError("usage", "--run is for recordings", "Leave out --run")
        found = _of_series(file, asked, column, perception)
    lines = said(found)
    for name, gain in gains.items():
        lines.append(f"{name} was asked for with {gain:g} times the variation of its file")
    payload = asdict(found) | {"perceptual_gain": gains}
    report(as_json, payload, lambda: stdout.print("\n".join(lines)))


def _amplified(events: Sequence[Event]) -> dict[str, float]:
    """The gain of each texture that was played amplified."""
    told = {
        e.message: float(e.data.get("perceptual_gain", 1.0)) for e in events if e.kind == "texture"
    }
    return {name: gain for name, gain in told.items() if gain != 1.0}


def _of_series(
    file: Path, asked: Path | None, column: list[str] | None, perception: Perception
) -> Fidelity:
    if asked is None:
        named = columns_named(column, (TIME, ASKED, FELT), f"{FELT}=mu")
        time_s, asked_cof, felt_cof = _columns(file, (TIME, ASKED, FELT), named)
    else:
        time_s, felt_cof = _pairs(file)
        asked_s, asked_at = _pairs(asked)
        both = (time_s >= asked_s[0]) & (time_s <= asked_s[-1])
        time_s, felt_cof = time_s[both], felt_cof[both]
        asked_cof = np.interp(time_s, asked_s, asked_at)
    if time_s.size < 2 or not np.median(np.diff(time_s)) > 0.0:
        raise BadInputError("bad_table", f"{file}: has no two rows at times of both", WANTED)
    tick_s = float(np.median(np.diff(time_s)))
    even_s = np.arange(time_s[0], time_s[-1], tick_s)
    asked_cof, felt_cof = (np.interp(even_s, time_s, x) for x in (asked_cof, felt_cof))
    after = np.clip(np.searchsorted(time_s, even_s), 1, time_s.size - 1)
    felt_cof[time_s[after] - time_s[after - 1] > GAP_TICKS * tick_s] = np.nan
    every = np.ones(even_s.size)
    return fidelity_of([Stroke(asked_cof, felt_cof, every, every > 0.0)], tick_s, perception)


def _columns(file: Path, names: tuple[str, ...], named: Mapping[str, Named]) -> list[Array]:
    """Columns of the rows that have all of them, in the order of time."""
    table = read_table(file, names, WANTED, named=named)
    rows = np.array([table.numbers(name, where_empty=np.nan) for name in names])
    rows = rows[:, np.isfinite(rows).all(axis=0)]
    return _in_order(file, rows)


def _pairs(file: Path) -> list[Array]:
    """Time and friction, of a file with or without a header."""
    try:
        with file.open(encoding="utf-8-sig") as lines:
            first = next(lines, "").replace(";", ",").split(",")
            has_header = not all(map(_is_number, first[:2]))
            rows = np.loadtxt(
                file, delimiter=",", skiprows=int(has_header), usecols=(0, 1), ndmin=2
            )
    except (OSError, ValueError, UnicodeDecodeError) as error:
        raise BadInputError("bad_table", f"{file}: {error}", WANTED) from error
    return _in_order(file, rows.T)


def _in_order(file: Path, rows: Array) -> list[Array]:
    if not (np.diff(rows[0]) >= 0.0).all():
        raise BadInputError("bad_table", f"{file}: its times go back", WANTED)
    return list(rows)


def _is_number(cell: str) -> bool:
    try:
        number(cell.strip())
    except ValueError:
        return False
    return True
