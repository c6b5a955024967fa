"""When each frame of a film was taken, from a file of time stamps."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from haptic_driver.errors import BadInputError
from haptic_driver.files import bad_input
from haptic_driver.signals import Array
from model.support.reading import read_bytes
from model.support.text import SEPARATORS, Line, decoded, is_value, numbers, split, times
from model.support.units import named_unit, suffix_unit, to_si

TIME = re.compile(r"time|stamp|zeit|^t\b", re.IGNORECASE)
WHICH = "Give a header with a column time_s or time_ms, or a line per frame with its seconds alone"
ONE_A_FRAME = "Are they of this film, one a frame?"


def read_times(path: Path, count: int) -> Array:
    """Time stamps in s since the first: the column of time, in the unit of its name, or dates.

    BadInputError where no column is surely that of time, or there is not one for each frame. So
    where its unit is not said and can hardly be seconds.
    """
    with bad_input("bad_times"):
        header, rows = _table(path)
    if len(rows) != count:
        said = f"{path}: has {len(rows)} time stamps for {count} frames"
        raise BadInputError("bad_times", said, ONE_A_FRAME)
    names = header or [""] * len(rows[0].cells)
    place = _place(path, names, rows, has_header=bool(header))
    time_s = _seconds(path, names[place], [row.cells[place] for row in rows])
    wrong = np.flatnonzero(~(np.diff(time_s) > 0.0))
    if wrong.size:
        said = f"{path}, line {rows[int(wrong[0]) + 1].number}: times do not rise"
        raise BadInputError("bad_times", said, ONE_A_FRAME)
    return np.asarray(time_s - time_s[0])


def _table(path: Path) -> tuple[list[str], list[Line]]:
    """The header, empty where there is none, and the rows."""
    text = decoded(path, read_bytes(path))
    whole = [line.strip() for line in text.splitlines() if line.strip()]
    if whole and times(whole) is not None:
        return [], [Line(i, [line]) for i, line in enumerate(whole, start=1)]
    for separator in SEPARATORS:
        lines = [line for line in split(path, text, separator) if any(line.cells)]
        lines = [line for line in lines if not line.cells[0].startswith("#")]
        if not lines:
            raise BadInputError("bad_times", f"{path}: is empty", WHICH)
        if len({len(line.cells) for line in lines}) == 1 and len(lines[-1].cells) > 1:
            break
    else:
        lines = [Line(line.number, [" ".join(line.cells)]) for line in lines]
    has_header = not any(map(is_value, lines[0].cells))
    return (lines[0].cells, lines[1:]) if has_header else ([], lines)


def _place(path: Path, names: Sequence[str], rows: Sequence[Line], *, has_header: bool) -> int:
    """The column of time: by its name; without names the one that is no counter of frames."""
    known = [i for i in range(len(names)) if all(is_value(row.cells[i]) for row in rows)]
    if has_header and len(known) > 1:
        known = [i for i in known if TIME.search(names[i])]
    if len(known) == 2 and not has_header:
        first = [row.cells[known[0]] for row in rows]
        begin = int(first[0]) if first[0].isdigit() else 0
        if first == [str(begin + i) for i in range(len(rows))]:
            known = known[1:]
    if len(known) != 1:
        said = f"{path}: {len(known)} columns may be the time"
        raise BadInputError("bad_times", said, WHICH)
    return known[0]


def _seconds(path: Path, name: str, cells: Sequence[str]) -> Array:
    dated = None if all(cell.isdigit() for cell in cells) else times(cells)
    if dated is not None:
        return dated
    unit = named_unit(name).unit or suffix_unit(name, "s").unit
    with bad_input("bad_times"):
        values = numbers(str(path), cells)
        if unit:
            return np.asarray(to_si("time", unit, f"{path}: {name}") * values)
    step = float(np.median(np.diff(values))) if values.size > 1 else 0.0
    if step >= 1.0:
        said = f"{path}: frames are {step:g} apart, and nothing says whether in s or in ms"
        raise BadInputError("bad_times", said, WHICH)
    return values
