"""`haptic calibrate`: one finger's own numbers from its measured friction."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from rich.table import Table
from typer import Argument, Option

from haptic_driver.cli.output import Json, ModelOption, RowsOption, report, status, stdout
from haptic_driver.errors import BadInputError
from haptic_driver.files import bad_input, require_ending, require_free, writing
from haptic_driver.lab.commands.columns import (
    ColumnOption,
    MapOption,
    columns_named,
    refuse_both,
    tell_doubts,
)
from haptic_driver.lab.measuring.recordings import read_data
from haptic_driver.lab.pictures.model import draw_calibration
from haptic_driver.lab.raw_trials.folder import write_trials
from haptic_driver.lookup.models import load_model
from model.analysis.calibration import OPTIONAL, Calibration, write_calibration
from model.analysis.calibration import calibrate as run
from model.diagnosis.data import COLUMNS, Measurements
from model.diagnosis.space import FINGER
from model.support.errors import nearest


def calibrate(
    data: Annotated[
        Path, Argument(help="CSV: frequency_hz, voltage_v, ..., cof; a recording (.h5); or trials.")
    ],
    model: ModelOption = "reference",
    out: Annotated[Path, Option(help="Model file to write; its picture stands beside it.")] = Path(
        "finger.toml"
    ),
    also: Annotated[
        list[str] | None, Option(help="A further parameter to fit; repeatable.")
    ] = None,
    column: ColumnOption = None,
    map_file: MapOption = None,
    rows: RowsOption = None,
    as_json: Json = False,
) -> None:
    """Fit a finger's own numbers (roughness, skin thickness, leakage, friction at 0 V) to its data.

    A recording of `haptic record` is cut into rows of steady sliding, which `--rows out.csv` keeps.

    With `--map` the data are raw trial files, or a folder of them, whose rows are those of `haptic
    rows`. `--column cof=COF_mean:1` says what a table calls a column, and in which unit it is.

    Says how far each is known, which the data cannot tell apart, and how well the model fits.

    Example: `haptic calibrate data.csv --model reference --out finger.toml`
    """
    description = load_model(model)
    _check(also or [], out)
    refuse_both(map_file, column)
    named = columns_named(column, COLUMNS, "cof=COF_mean:1")
    measurements = (
        read_data([data], rows, named=named)
        if map_file is None
        else _of_trials(data, map_file, rows or out.with_suffix(".rows.csv"))
    )
    with bad_input("bad_data"), status("fitting"):
        found = run(description, measurements, also or ())
    with writing(out):
        write_calibration(found, description, out, data.name)
    picture = out.with_suffix(".png")
    draw_calibration(found, picture)
    report(as_json, _payload(found, out, picture), lambda: _show(found, out, picture))


def _of_trials(trials: Path, map_file: Path, rows: Path) -> Measurements:
    """The rows of raw trials, which are kept in `rows`."""
    require_free(rows, option="--rows")
    tell_doubts(write_trials([trials], map_file, rows))
    return read_data([rows])


def _check(also: list[str], out: Path) -> None:
    """What can be known to be wrong before the data are read and fitted."""
    always = [n.name for n in FINGER]
    names = always + [n.name for n in OPTIONAL]
    for name in also:
        if name not in names:
            hint = f"{nearest(name, names)}; fitted in any case: {', '.join(always)}"
            raise BadInputError("bad_parameter", f"--also {name}: there is no such parameter", hint)
    require_ending(out, [".toml"])  # or no command would find the model


def _payload(found: Calibration, out: Path, picture: Path) -> dict[str, Any]:
    return {
        "model": str(out),
        "picture": str(picture),
        "rows": found.data.count,
        "chi2": found.fit.chi2,
        "chi2_per_point": found.chi2_per_point,
        "noise_source": found.noise.source,
        "parameters": {
            p.name: {k: v for k, v in p._asdict().items() if k != "name"} for p in found.parameters
        },
        "correlated": [{"names": [a, b], "correlation": r} for a, b, r in found.correlated],
        "at_an_end": list(found.at_an_end),
        "read_as": list(found.data.read_as),
        "warnings": list(found.warnings),
    }


def _show(found: Calibration, out: Path, picture: Path) -> None:
    table = Table("parameter", "value", "95 % interval", "unit", "std/prior", box=None)
    for p in found.parameters:
        low, high = p.interval_95
        bound = "bound: " if p.name in found.at_an_end else ""
        table.add_row(
            p.name, f"{bound}{p.value:.4g}", f"{low:.4g} to {high:.4g}", p.unit, f"{p.learnt:.2f}"
        )
    stdout.print(table)
    stdout.print(f"chi-square per point {found.chi2_per_point:.2f} over {found.data.count} rows")
    for said in found.data.read_as:
        stdout.print(said)
    for warning in found.warnings:
        stdout.print(f"note: {warning}")
    stdout.print(f"model: {out}, picture: {picture}")
