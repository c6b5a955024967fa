"""The columns that a map names, by their role and in SI."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from haptic_driver.errors import BadInputError
from haptic_driver.lab.force_signal import FEWEST
from haptic_driver.lab.raw_trials.columns import ITS_DATES, Column, Source
from haptic_driver.lab.raw_trials.trial_map import ColumnSaid, TrialMap
from haptic_driver.signals import Array
from model.support.units import SI, named_unit, of_kind, same, suffix_unit, to_si, understood

SAME_RATE = 1e-3  # two rates that are one


@dataclass(frozen=True)
class Quantities:
    """Columns [n] in SI by role; `lines` [n] of a text where each sample stands, else empty.

    `raw` has the columns as they stand in the file, by role.
    """

    path: Path
    columns: Mapping[str, Array]
    raw: Mapping[str, Array]
    lines: Sequence[int]

    def place(self, sample: int) -> str:
        """A sample, from 0, as its second and its line."""
        time_s = self.columns["time"]
        said = f"{time_s[sample]:.6g} s" if sample < time_s.size else f"sample {sample + 1}"
        return f"{said} (line {self.lines[sample]})" if self.lines else said


def given_roles(said: TrialMap) -> dict[str, ColumnSaid]:
    """What a map says of columns, by role."""
    roles = {role: getattr(said.columns, role) for role in type(said.columns).model_fields}
    return {role: wanted for role, wanted in roles.items() if wanted is not None}


def quantities(source: Source, said: TrialMap) -> Quantities:
    """The columns of a map in SI; BadInputError for what is not as it says."""
    columns, raw = dict[str, Array](), dict[str, Array]()
    given = given_roles(said)
    used = {role: _find(source, role, wanted) for role, wanted in given.items()}
    _check_waveforms(source.path, used, said.file.rate_hz)
    for role, wanted in given.items():
        column = used[role]
        where = f"{source.path}: columns.{role}"
        unit = _unit(role, wanted, column, where)
        _refuse_scaled(role, wanted, column, where)
        raw[role] = values = column.read()
        if not np.isfinite(values).any():
            raise _no_numbers(where, source, column)
        if wanted.unwrap is not None:
            values = np.unwrap(values, period=wanted.unwrap)
        factor = to_si(role, unit, where, wanted.gain_unit) * wanted.gain * wanted.sign
        columns[role] = factor * (values - wanted.offset)
    _check_sizes(source.path, columns)
    if "time" not in columns:
        assert said.file.rate_hz is not None
        columns["time"] = np.arange(columns["lateral_force"].size) / said.file.rate_hz
    found = Quantities(source.path, columns, raw, source.lines)
    _check_time(found)
    for role in ("position", "speed", "electrode_voltage"):
        if role in columns and not np.isfinite(columns[role]).all():
            at = int(np.argmin(np.isfinite(columns[role])))
            said_no = f"{source.path}: {role} is no number at {found.place(at)}"
            raise BadInputError("bad_trial", said_no, "Is the file whole?")
    return found


def _no_numbers(where: str, source: Source, column: Column) -> BadInputError:
    """What to raise for a column of texts: 0x2f, 3.0D-01, 0.3 N."""
    said = f"{where}: column {column.name} has no number"
    if source.text is not None and column.place is not None:
        said += f"; its first cell is '{source.text.cells(column.place - 1)[0]}'"
    return BadInputError("bad_trial", said, "Save plain numbers, such as 0.3 or 3e-1")


def _find(source: Source, role: str, wanted: ColumnSaid) -> Column:
    """A column by its name, or by its name without the unit at its end."""
    try:
        return source.find(wanted)
    except BadInputError as error:
        if error.code != "missing_column":
            raise
        bare = [c for c in source.columns if suffix_unit(c.name, SI[role]).bare == wanted.name]
        if len(bare) != 1:
            raise
        return bare[0]


def unit_said(role: str, column: Column) -> tuple[str, str]:
    """The unit of a column by its file, and where the file says it."""
    if column.unit:
        return column.unit, column.unit_from
    unit = suffix_unit(column.name, SI[role]).unit
    return unit, "its name" if unit else ""


def _unit(role: str, wanted: ColumnSaid, column: Column, where: str) -> str:
    """The unit of a column; BadInputError where none says it, or map and file differ."""
    own, own_from = unit_said(role, column)
    if wanted.unit is None and not own:
        hint = f"Give columns.{role}.unit"
        raise BadInputError("unknown_unit", f"{where} has no unit", hint)
    if own_from == ITS_DATES:
        return own
    named = named_unit(column.name).unit or suffix_unit(column.name, SI[role]).unit
    if wanted.overrides_file and wanted.unit is not None:
        return wanted.unit
    if role in of_kind(named) and understood(own) is not None and not same(own, named):
        told = f"{where} is in {named} by its name, and in {own} by {own_from}"
        hint = f"Give columns.{role}.unit, and say overrides_file = true beside it"
        raise BadInputError("unit_conflict", told, hint)
    if wanted.unit is None:
        return own
    is_known = own and understood(own) is not None
    if is_known and not same(own, wanted.unit):
        told = f"{where} is in {wanted.unit} by the map, and in {own} by {own_from}"
        hint = f"Leave columns.{role}.unit out, or say overrides_file = true beside it"
        raise BadInputError("unit_conflict", told, hint)
    return wanted.unit


def _refuse_scaled(role: str, wanted: ColumnSaid, column: Column, where: str) -> None:
    """BadInputError for an attribute that may be in the numbers already, or not."""
    if column.scaled and wanted.gain == 1.0 and not wanted.overrides_file:
        told = f"{where}: its attribute says {column.scaled}, and nothing says whether it counts"
        hint = f"Give columns.{role}.gain; or overrides_file = true where the numbers hold it"
        raise BadInputError("unit_conflict", told, hint)


def _check_waveforms(path: Path, used: Mapping[str, Column], rate_hz: float | None) -> None:
    """BadInputError where channels began at different times, or at another rate than the map's."""
    began = {column.began for column in used.values()}
    if len(began) > 1:
        said = f"{path}: its channels begin at different times: {', '.join(sorted(began))}"
        raise BadInputError("bad_trial", said, "Save them from one time on, at one rate")
    for role, column in used.items():
        own_hz = column.rate_hz
        if rate_hz and own_hz and abs(own_hz / rate_hz - 1.0) > SAME_RATE and "time" not in used:
            said = (
                f"{path}: {role} is at {own_hz:g} Hz by the file, and file.rate_hz is {rate_hz:g}"
            )
            raise BadInputError("unit_conflict", said, f"Say file.rate_hz = {own_hz:g}")


def _check_sizes(path: Path, columns: Mapping[str, Array]) -> None:
    sizes = {role: values.size for role, values in columns.items()}
    if len(set(sizes.values())) > 1:
        said = ", ".join(f"{role} {size}" for role, size in sizes.items())
        raise BadInputError("bad_trial", f"{path}: columns differ in length: {said}")
    if min(sizes.values()) < FEWEST:
        raise BadInputError("bad_trial", f"{path}: has {min(sizes.values())} samples")


def _check_time(found: Quantities) -> None:
    time_s = found.columns["time"]
    if not np.isfinite(time_s).all():
        at = int(np.argmin(np.isfinite(time_s)))
        line = f" (line {found.lines[at]})" if found.lines else ""
        said = f"{found.path}: time is no number at sample {at + 1}{line}"
        hint = "Is the file whole, or does something else stand there, as another table?"
        raise BadInputError("bad_trial", said, hint)
    steps_s = np.diff(time_s)
    if (steps_s > 0.0).all():
        return
    at = int(np.argmin(steps_s)) + 1 if (steps_s < 0.0).any() else int(np.argmin(steps_s > 0)) + 1
    line = f" (line {found.lines[at]})" if found.lines else ""
    said = f"{found.path}: time does not rise at sample {at + 1}{line}"
    if steps_s[at - 1] == 0.0:
        hint = "Write time with more digits, or leave it out and give file.rate_hz"
    elif abs(time_s[at] - time_s[0]) < 0.1 * abs(time_s[at - 1] - time_s[0]):
        said, hint = f"{said}: it begins again", "Save each trial as a file of its own"
    else:
        hint = "Is that column time, or a counter that wraps? Then say unwrap = its range"
    raise BadInputError("bad_trial", said, hint)
