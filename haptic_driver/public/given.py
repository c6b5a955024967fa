"""What a script gives as columns in SI: numbers, arrays, quantities, tables and files."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from haptic_driver.errors import BadInputError, HapticError, message_of
from model.diagnosis.data import WORDS
from model.support.tables import read_table
from model.support.text import numbers
from model.support.units import Near, by_other_names, differ, is_rms, near, to_column, unit_of

TEXTS = (*WORDS, "doubts")
WANTED = "Give columns by our names, such as frequency_hz, voltage_v and normal_force_n"
WAVEFORM = "A root mean square is that of a sine here: give the amplitude"


@contextmanager
def bad_given(code: str, what: str) -> Iterator[None]:
    """What numpy, pint, pandas or xarray refuse of an input becomes a BadInputError."""
    try:
        yield
    except HapticError:
        raise
    except (ValueError, TypeError, KeyError, AttributeError, IndexError) as error:
        raise BadInputError(code, f"{what}: {message_of(error)}", WANTED) from error


def own_unit(name: str, value: Any) -> str:
    """The unit that a quantity or a labelled array says itself; columns of a DataFrame have those
    of all its columns.
    """
    said = getattr(value, "units", "") or getattr(value, "attrs", {}).get("units", "")
    return str(said.get(name, "") if isinstance(said, Mapping) else said)


def in_si(name: str, value: Any) -> NDArray[Any]:
    """A column of ours [...] in its own unit; words as texts. BadInputError names what is wrong."""
    with bad_given("bad_input", name):
        if name in TEXTS:
            return np.asarray(value, dtype=str)
        unit = own_unit(name, value)
        found = _plain(name, value)
        factor = to_column(name, unit, name) if unit else 1.0
        return np.asarray(found * factor, dtype=np.float64)


def _plain(name: str, value: Any) -> NDArray[Any]:
    values: Any = np.ma.asarray(getattr(value, "magnitude", value))
    if values.dtype.kind == "m" and unit_of(name) == "s" and values.dtype != "m8":
        values = values / np.timedelta64(1, "s")
    if values.dtype.kind not in "iufUSO":
        raise BadInputError("not_a_number", f"{name} is of {values.dtype}, no number", WANTED)
    if values.dtype.kind not in "USO":
        return np.asarray(values.astype(np.float64).filled(np.nan))
    texts = ["" if cell is None else str(cell) for cell in values.ravel()]
    found = numbers(name, texts).reshape(values.shape)
    for text, number in zip(texts, found.ravel(), strict=True):
        if np.isnan(number) and text.lower() not in ("", "nan", "<na>", "none"):
            raise BadInputError("not_a_number", f"{name} is {text!r}, not a number", WANTED)
    return np.asarray(found)


def columns_of(table: Any, known: Sequence[str]) -> dict[str, NDArray[Any]]:
    """The columns of a table that are ours, by name and unit; a file, a DataFrame or a dict."""
    if isinstance(table, str | Path):
        read = read_table(Path(table), (), WANTED, known=known)
        table = {name: read.text(name) for name in read.columns}
    with bad_given("bad_input", "the table"):
        names = [str(name) for name in table]
        require_one_index(table)
        found = {name: in_si(name, table[name]) for name in known if name in names}
        others = near(names, known)
    wanted = [*found, *(other.column for other in others.values())]
    for name in wanted:
        if names.count(name) > 1:
            raise BadInputError("bad_table", f"column {name} stands more than once", "Keep one")
    for ours, other in others.items():
        if not other.unit:
            said = f"column {other.column} may be {ours}, and its name has no unit"
            raise BadInputError("near_name", said, f"Call it {ours}, in {unit_of(ours)}")
        if is_rms(other.unit) and "waveform" in names:
            raise BadInputError("bad_input", f"{other.column} is {other.unit}", WAVEFORM)
        found[ours] = _of_near(ours, other, table)
    for ours, values in found.items():
        _check_agree(ours, values, table, names)
    return found


def _of_near(ours: str, other: Near, table: Any) -> NDArray[Any]:
    return to_column(ours, other.unit, other.column) * in_si(ours, table[other.column])


def _check_agree(ours: str, values: NDArray[Any], table: Any, names: list[str]) -> None:
    """BadInputError where a column says in another unit what one of ours says otherwise."""
    for other in by_other_names(names, ours):
        of_wave = is_rms(other.unit) and "waveform" in names
        if of_wave or not other.unit or names.count(other.column) > 1:
            continue
        pairs = zip(values.ravel(), _of_near(ours, other, table).ravel(), strict=False)
        if any(differ(*pair) for pair in pairs):
            said = f"{ours} and {other.column} say one quantity twice, and differ"
            raise BadInputError("bad_table", said, "Keep one, or rename it")


def require_one_index(columns: Any) -> None:
    """BadInputError where pandas Series have their rows in another order than the other columns."""
    indices: dict[Any, Any] = {}
    alone = False
    for name in columns:
        index = getattr(columns[name], "index", None)
        if hasattr(index, "equals"):
            indices[name] = index
        else:
            is_list = isinstance(columns[name], list | tuple)
            alone |= len(columns[name]) > 1 if is_list else getattr(columns[name], "size", 1) > 1
    first = next(iter(indices.values()), None)
    for name, index in indices.items():
        rises = getattr(index, "is_monotonic_increasing", True)
        if not index.equals(first) or (alone and not rises):
            said = f"the rows of {name} and of other columns have different labels or order"
            raise BadInputError("bad_table", said, "Give one DataFrame, or arrays by to_numpy()")


def is_table(data: Any) -> bool:
    """Whether data are a table in memory."""
    return isinstance(data, Mapping) or hasattr(data, "columns") or hasattr(data, "data_vars")
