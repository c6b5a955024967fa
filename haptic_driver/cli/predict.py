"""`haptic predict`: the model's answer for a table of conditions."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from haptic_driver.cli.output import Json, ModelOption, report, stderr, stdout
from haptic_driver.config import load_model
from haptic_driver.errors import BadInputError, HapticError
from model.errors import ModelError
from model.touch_model import Conditions, Prediction, TouchModel

REQUIRED = ("frequency_hz", "voltage_v", "normal_force_n")
ADDED = ("electrostatic_force_n", "cof", "current_rms_a")
WANTED = f"Give a CSV with columns {', '.join(REQUIRED)} (optional voltage_offset_v, waveform: sine, square, dc)"

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
    is carried through.

    Example: `haptic predict --table conditions.csv --out out.csv --model reference`
    """
    header, rows = _read(table)
    description = load_model(model)
    try:
        answer = TouchModel(description).predict(_conditions(rows, table))
    except ModelError as error:
        raise BadInputError("bad_condition", f"{table}, {error.message}", error.hint) from error
    _write(out, header, rows, answer)
    outside = int(np.sum(~answer.within_theory))
    if outside:
        stderr.print(f"warning: {outside} of {len(rows)} rows lie outside the theory's pressures (p_e above 10 p0)")
    payload = {"rows": len(rows), "out": str(out), "model": description.name, "outside_theory": outside}
    report(as_json, payload, lambda: stdout.print(f"{len(rows)} rows by model '{description.name}' -> {out}"))


def _read(path: Path) -> tuple[list[str], Rows]:
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            reader = csv.DictReader(file, restkey="", restval="")
            rows = [{**row, LINE: str(reader.line_num)} for row in reader]
            header = list(reader.fieldnames or [])
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        reason = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
        raise BadInputError("bad_table", f"{path}: cannot be read: {reason}", WANTED) from error
    for column in REQUIRED:
        if column not in header:
            found = f"; found: {', '.join(header)}" if header else " (the file is empty)"
            raise BadInputError("missing_column", f"{path}: column {column} is missing{found}", WANTED)
    for column in header:
        if header.count(column) > 1:
            raise BadInputError("bad_table", f"{path}: column {column} stands more than once", "Keep one of them")
    for row in rows:
        if "" in row:
            raise BadInputError("bad_table", f"{path}, line {row[LINE]}: has more fields than the header", WANTED)
    if not rows:
        raise BadInputError("bad_table", f"{path}: has no rows", WANTED)
    return header, rows


def _conditions(rows: Rows, path: Path) -> Conditions:
    voltage = _column(rows, "voltage_v", path)
    waveform = None
    if "waveform" in rows[0]:
        waveform = np.array([row["waveform"].strip().lower() or "sine" for row in rows])
    undriven = {i for i, v in enumerate(voltage) if v == 0.0}
    steady = set() if waveform is None else {i for i, name in enumerate(waveform) if name == "dc"}
    return Conditions(
        frequency_hz=_column(rows, "frequency_hz", path, ignored=undriven | steady),
        voltage_v=voltage,
        normal_force_n=_column(rows, "normal_force_n", path),
        voltage_offset_v=_column(rows, "voltage_offset_v", path) if "voltage_offset_v" in rows[0] else None,
        waveform=waveform,
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
        if name == "voltage_offset_v" and not text:
            values[i] = 0.0
            continue
        try:
            values[i] = float(text)
        except ValueError:
            values[i] = np.nan
        if not np.isfinite(values[i]):
            raise BadInputError("not_a_number", f"{path}, line {row[LINE]}: {name} is '{text}', not a number", WANTED)
    return values


def _write(path: Path, header: list[str], rows: Rows, answer: Prediction) -> None:
    columns = [c for c in header if c not in ADDED]
    answers = np.column_stack([answer.electrostatic_force_n, answer.cof, answer.current_rms_a])
    try:
        with path.open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file)
            writer.writerow([*columns, *ADDED])
            for row, values in zip(rows, answers, strict=True):
                writer.writerow([row[c] for c in columns] + [f"{v:.9g}" for v in values])
    except OSError as error:
        raise HapticError(
            "not_written", f"{path}: cannot be written ({error.strerror})", "Choose another --out"
        ) from error
