"""`haptic predict`: the model's answer for a table of conditions."""

from __future__ import annotations

import csv
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated, Any

import numpy as np
from typer import Option

from haptic_driver.cli.output import Json, ModelOption, report, stderr, stdout
from haptic_driver.errors import BadInputError
from haptic_driver.files import replacing
from haptic_driver.lab.commands.columns import (
    ColumnOption,
    MapOption,
    columns_named,
    refuse_both,
    tell_doubts,
)
from haptic_driver.lab.raw_trials.folder import write_trials
from haptic_driver.lookup.models import load_model
from model.analysis.voltage_law import beyond_published
from model.conditions import Conditions
from model.support.arrays import Array
from model.support.cells import written_cells
from model.support.errors import ModelError, RowError
from model.support.tables import Named, Table, read_table
from model.touch import SPEED_REFERENCE_M_S
from model.touch_model import Prediction, TouchModel

REQUIRED = ("frequency_hz", "voltage_v", "normal_force_n")
ADDED = ("electrostatic_force_n", "cof", "current_rms_a", "current_a", "current_phase_rad")
ELECTRODE = (
    "electrode_voltage_v",
    "electrode_voltage_phase_rad",
)  # where an effect of the drive changes it
WHERE_EMPTY = {
    "voltage_offset_v": 0.0,
    "speed_m_s": SPEED_REFERENCE_M_S,
    "time_s": 0.0,
    "contact_area_m2": np.nan,
}  # optional columns
WANTED = (
    f"Give a CSV with columns {', '.join(REQUIRED)} (optional {', '.join(WHERE_EMPTY)}, waveform:"
    " sine, square, dc; finger: sliding, resting, none)"
)
MAY_HAVE = ("cof", "lateral_force_n", "waveform", "finger")
MEASURED = "_measured"  # after the name of a column that an answer would replace


def predict(
    table: Annotated[Path, Option(help="CSV: frequency_hz, voltage_v, normal_force_n.")],
    out: Annotated[Path, Option(help="CSV to write: all columns and the answers.")],
    model: ModelOption = "reference",
    column: ColumnOption = None,
    map_file: MapOption = None,
    as_json: Json = False,
) -> None:
    """Predict force, friction and current for a table of conditions.

    Voltages are peak amplitudes at the electrode; where `voltage_v` is 0 the frequency is ignored.
    `current_rms_a` is the touch's; `current_a` and `current_phase_rad` are the electrode's, peak
    and against the set voltage, with what the model's stray capacitance takes. Where an effect of
    the drive changes the electrode's voltage, that is added too. Every other column is carried
    through; a measured `cof` as `cof_measured`, which may also come of `lateral_force_n`. The
    answers of an earlier run are replaced.

    `--column voltage_v=U:kV` says what the table calls a column, and in which unit it is; the
    column in SI is added. With `--map` the table is raw trial files, or a folder of them, whose
    rows are those of `haptic rows`.

    Example: `haptic predict --table conditions.csv --out out.csv --model reference`
    """
    refuse_both(map_file, column)
    named = columns_named(column, (*REQUIRED, *WHERE_EMPTY, *MAY_HAVE), "voltage_v=U:kV")
    given = _table(table, named) if map_file is None else _trials(table, map_file)
    if not given.rows:
        raise BadInputError("bad_table", f"{table}: has no rows", WANTED)
    given = _with_measured(given)
    columns = _columns(given)
    description = load_model(model)
    try:
        conditions = Conditions(**columns)
        if beyond := description.outside(conditions.drive()):
            raise ModelError(
                f"effect learned knows nothing at {beyond}",
                "Ask within its range, or measure there",
            )
        finger = TouchModel(description)
        answer = finger.predict(conditions)
        steep = _steep(finger, columns)
    except RowError as error:
        said = f"{given.where(error.row)}: {error.said}"
        raise BadInputError("bad_condition", said, error.hint) from error
    except ModelError as error:
        raise BadInputError("bad_condition", f"{table}, {error.message}", error.hint) from error
    answers = _answers(answer, any(effect.stage == "drive" for effect in description.effects))
    kept = _kept(given, tuple(answers))
    _write(out, kept, given, answers)
    for theirs, name in kept.items():
        if name != theirs:
            stderr.print(
                f"note: column {theirs} of {table} is kept as {name}; {theirs} is now the model's"
                " answer"
            )
    notes = [*given.notes, *given.doubted(), *answer.notes, *steep]
    for note in notes:
        stderr.print(f"note: {note}")
    count, outside = len(given.rows), int(np.sum(~answer.within_theory))
    if outside:
        stderr.print(
            f"warning: {outside} of {count} rows lie outside the theory's pressures (p_e above"
            " 10 p0)"
        )
    payload = {
        "rows": count,
        "out": str(out),
        "model": description.name,
        "outside_theory": outside,
        "notes": notes,
    }
    report(
        as_json,
        payload,
        lambda: stdout.print(f"{count} rows by model '{description.name}' -> {out}"),
    )


def _steep(finger: TouchModel, columns: Mapping[str, Any]) -> list[str]:
    """What is known of the row that published fingers contradict first: the most voltage, and of
    those the least load.
    """
    names = ("frequency_hz", "voltage_v", "normal_force_n")
    rows = np.column_stack([np.asarray(columns[name], dtype=float) for name in names])
    first = np.lexsort((rows[:, 2], -rows[:, 1]))[0]
    said = beyond_published(finger, *map(float, rows[first]))
    return [] if said is None else [said]


def _table(path: Path, named: Mapping[str, Named]) -> Table:
    """The table; no column of its own may be lost beside one that is given its name."""
    for ours, one in named.items():
        if ours != one.column and ours in read_table(path, (), WANTED).columns:
            said = f"{path}: has a column {ours} of its own, beside {one.column}"
            raise BadInputError("bad_table", said, "Rename it, or leave out --column")
    known = [*WHERE_EMPTY, *MAY_HAVE]
    return read_table(path, REQUIRED, WANTED, known=known, named=named)


def _trials(path: Path, map_file: Path) -> Table:
    """The rows of raw trials."""
    with TemporaryDirectory() as folder:
        rows = Path(folder) / "rows.csv"
        tell_doubts(write_trials([path], map_file, rows))
        return read_table(rows, REQUIRED, WANTED)


def _with_measured(table: Table) -> Table:
    """The table with measured friction, where it has lateral forces alone."""
    name = f"cof{MEASURED}"
    if "lateral_force_n" not in table.columns or {"cof", name} & set(table.columns):
        return table
    lateral_n, load_n = (table.numbers(n, np.nan) for n in ("lateral_force_n", "normal_force_n"))
    with np.errstate(divide="ignore", invalid="ignore"):
        cof = np.abs(lateral_n) / load_n
    texts = [f"{value:.9g}" if np.isfinite(value) else "" for value in cof]
    rows = [row | {name: text} for row, text in zip(table.rows, texts, strict=True)]
    return replace(table, columns=[*table.columns, name], rows=rows)


def _columns(table: Table) -> dict[str, Any]:
    """What `Conditions` takes, by name."""
    columns: dict[str, Any] = {
        name: table.numbers(name) for name in ("voltage_v", "normal_force_n")
    }
    columns |= {
        name: table.numbers(name, empty)
        for name, empty in WHERE_EMPTY.items()
        if name in table.columns
    }
    without_frequency = columns["voltage_v"] == 0.0
    if "finger" in table.columns:
        columns["finger"] = np.array([text.lower() or "sliding" for text in table.text("finger")])
    if "waveform" in table.columns:
        columns["waveform"] = np.array([text.lower() or "sine" for text in table.text("waveform")])
        without_frequency |= columns["waveform"] == "dc"
    return {"frequency_hz": table.numbers("frequency_hz", ignored=without_frequency), **columns}


def _answers(answer: Prediction, drive_changes: bool) -> dict[str, Array]:
    """What is added, by column; the electrode's voltage where the drive changes what was set."""
    current_a, electrode_v = answer.electrode_current_a, answer.electrode_voltage_v
    values = (
        answer.electrostatic_force_n,
        answer.cof,
        answer.current_rms_a,
        np.abs(current_a),
        np.angle(current_a),
    )
    answers = dict(zip(ADDED, values, strict=True))
    if drive_changes:
        answers |= dict(zip(ELECTRODE, (np.abs(electrode_v), np.angle(electrode_v)), strict=True))
    return answers


def _kept(table: Table, added: tuple[str, ...]) -> dict[str, str]:
    """Columns to carry through, and the names they get: answers of an earlier run go, what was
    measured stays.
    """
    header = table.columns
    if all(name in header for name in ADDED):
        return {name: name for name in header if name not in (*ADDED, *ELECTRODE)}
    kept = {name: name + MEASURED if name in added else name for name in header}
    for column, name in kept.items():
        if name != column and name in header:
            said = f"{table.path}: has both {column} and {name}"
            raise BadInputError("bad_table", said, "Keep or rename one of them")
    return kept


def _write(path: Path, kept: dict[str, str], table: Table, answers: dict[str, Array]) -> None:
    """As a whole: the table may be its own source."""
    with replacing(path) as part, part.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(written_cells([*kept.values(), *answers]))
        for row, values in zip(table.rows, np.column_stack(list(answers.values())), strict=True):
            writer.writerow(written_cells([*(row[c] for c in kept), *(f"{v:.9g}" for v in values)]))
