"""Measured data that a script gives as a table in memory."""

from __future__ import annotations

from collections.abc import Sequence
from math import isnan
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from haptic_driver.errors import BadInputError
from haptic_driver.files import write_rows
from haptic_driver.lab.measuring.recordings import read_data
from haptic_driver.public.given import WANTED, bad_given, columns_of
from model.diagnosis.data import Measurements


def measurements_of(data: Any, known: Sequence[str]) -> Measurements:
    """Measured data of a table in memory: a DataFrame, a dict of columns, or rows as a list."""
    if isinstance(data, Sequence):
        data = {name: [row[name] for row in data] for name in (data[0] if data else {})}
    columns = columns_of(data, [*known, "doubts"])
    with bad_given("bad_data", "the table"):
        columns = dict(zip(columns, np.broadcast_arrays(*columns.values()), strict=True))
        lines = zip(*(values.tolist() for values in columns.values()), strict=True)
        rows = [dict(zip(columns, map(_cell, line), strict=True)) for line in lines]
    if not rows:
        raise BadInputError("bad_data", "the table has no rows of ours", WANTED)
    with TemporaryDirectory() as folder:
        path = Path(folder) / "table.csv"
        write_rows(path, rows)
        try:
            return read_data([path])
        except BadInputError as error:
            said = error.message.replace(str(path), "the table")
            raise BadInputError(error.code, said, error.hint) from error


def _cell(value: Any) -> str:
    is_nothing = isinstance(value, float) and isnan(value)
    return value if isinstance(value, str) else "" if is_nothing else repr(value)
