"""`haptic predict`: the model's answer for a table of conditions."""

from __future__ import annotations

import csv
import os
from contextlib import suppress
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from haptic_driver.cli.output import Json, ModelOption, report, stderr, stdout
from haptic_driver.config import load_model
from haptic_driver.errors import BadInputError
from haptic_driver.files import not_written
from haptic_driver.tables import read_table
from model.effects.base import SPEED_REFERENCE_M_S
from model.errors import ModelError
from model.touch_model import Conditions, Prediction, TouchModel

REQUIRED = ("frequency_hz", "voltage_v", "normal_force_n")
ADDED = ("electrostatic_force_n", "cof", "current_rms_a")
WHERE_EMPTY = {"voltage_offset_v": 0.0, "speed_m_s": SPEED_REFERENCE_M_S, "time_s": 0.0}  # optional columns
WANTED = (
    f"Give a CSV with columns {', '.join(REQUIRED)} (optional {', '.join(WHERE_EMPTY)}, waveform: sine, square, dc)"
)
MEASURED = "_measured"  # after the name of a column that an answer would replace

Rows = list[dict[str, str]]
LINE = "\nline"  # where each row keeps its line in the file; no column can have this name


def predict(
    table: Annotated[Path, typer.Option("--table", help="CSV: frequency_hz, voltage_v, normal_force_n.")],
    out: Annotated[Path, typer.Option("--out", help="CSV to write: all columns and the answers.")],
    model: ModelOption = "reference",
    as_json: Json = False,
) -> None:
    """Predict force, friction and current for a table of conditions.

    Voltages are peak amplitudes at the electrode; where `voltage_v` is 0 the frequency is ignored. Every other column
    is carried through; a measured `cof` as `cof_measured`. The answers of an earlier run are replaced.

    Example: `haptic predict --table conditions.csv --out out.csv --model reference`
    """
    header, rows = _read(table)
    description = load_model(model)
    try:
        answer = TouchModel(description).predict(_conditions(rows, table))
    except ModelError as error:
        raise BadInputError("bad_condition", f"{table}, {error.message}", error.hint) from error
    kept = _kept(header, table)
    _write(out, kept, rows, answer)
    for column, name in kept.items():
        if name != column:
            stderr.print(f"note: column {column} of {table} is kept as {name}; {column} is now the model's answer")
    for note in answer.notes:
        stderr.print(f"note: {note}", markup=False)
    outside = int(np.sum(~answer.within_theory))
    if outside:
        stderr.print(f"warning: {outside} of {len(rows)} rows lie outside the theory's pressures (p_e above 10 p0)")
    payload = {"rows": len(rows), "out": str(out), "model": description.name, "outside_theory": outside}
    report(as_json, payload, lambda: stdout.print(f"{len(rows)} rows by model '{description.name}' -> {out}"))


def _read(path: Path) -> tuple[list[str], Rows]:
    table = read_table(path, REQUIRED, WANTED)
    if not table.rows:
        raise BadInputError("bad_table", f"{path}: has no rows", WANTED)
    return table.columns, [{**row, LINE: str(line)} for row, line in zip(table.rows, table.lines, strict=True)]


def _conditions(rows: Rows, path: Path) -> Conditions:
    voltage = _column(rows, "voltage_v", path)
    waveform = None
    if "waveform" in rows[0]:
        waveform = np.array([row["waveform"].strip().lower() or "sine" for row in rows])
    undriven = {i for i, v in enumerate(voltage) if v == 0.0}
    steady = set() if waveform is None else {i for i, name in enumerate(waveform) if name == "dc"}
    optional = {name: _column(rows, name, path) for name in WHERE_EMPTY if name in rows[0]}
    return Conditions(
        frequency_hz=_column(rows, "frequency_hz", path, ignored=undriven | steady),
        voltage_v=voltage,
        normal_force_n=_column(rows, "normal_force_n", path),
        waveform=waveform,
        **optional,
    )


def _column(
    rows: Rows, name: str, path: Path, ignored: set[int] | None = None
) -> np.ndarray[Any, np.dtype[np.float64]]:
    values = np.empty(len(rows))
    for i, row in enumerate(rows):
        text = row[name].strip()
        if ignored and i in ignored:
            values[i] = 0.0
            continue
        if name in WHERE_EMPTY and not text:
            values[i] = WHERE_EMPTY[name]
            continue
        try:
            values[i] = float(text)
        except ValueError:
            values[i] = np.nan
        if not np.isfinite(values[i]):
            raise BadInputError("not_a_number", f"{path}, line {row[LINE]}: {name} is '{text}', not a number", WANTED)
    return values


def _kept(header: list[str], path: Path) -> dict[str, str]:
    """Columns to carry through, and the names they get: answers of an earlier run go, what was measured stays."""
    if all(name in header for name in ADDED):
        return {name: name for name in header if name not in ADDED}
    kept = {name: name + MEASURED if name in ADDED else name for name in header}
    for column, name in kept.items():
        if name != column and name in header:
            raise BadInputError("bad_table", f"{path}: has both {column} and {name}", "Keep or rename one of them")
    return kept


def _write(path: Path, kept: dict[str, str], rows: Rows, answer: Prediction) -> None:
    """Atomically: the table may be its own source, and is never left half written."""
    answers = np.column_stack([answer.electrostatic_force_n, answer.cof, answer.current_rms_a])
    part = path.with_name(f"{path.name}.{os.getpid()}.part")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with part.open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file)
            writer.writerow([*kept.values(), *ADDED])
            for row, values in zip(rows, answers, strict=True):
                writer.writerow([row[c] for c in kept] + [f"{v:.9g}" for v in values])
        os.replace(part, path)
    except OSError as error:
        raise not_written(path, error) from error
    finally:
        with suppress(OSError):
            part.unlink(missing_ok=True)
