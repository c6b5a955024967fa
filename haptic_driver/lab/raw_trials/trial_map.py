"""What the map of raw trial files may say: where columns stand, marks, windows and conditions."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import Field, field_validator, model_validator

from haptic_driver.config import Section, parse
from haptic_driver.lab.raw_trials.layout import Layout
from model.support.reading import read_toml

Seconds = Annotated[float, Field(ge=-1e6, le=1e6)]
TEXTS = ("session", "trial", "setting", "waveform")
QUANTITIES = ("voltage", "frequency", "normal_force", "speed", "voltage_offset")
CONDITIONS = (*QUANTITIES, *TEXTS)


class FileLook(Section):
    """How the files are written; what is left out is found, or goes by the file's ending."""

    kind: Literal["text", "labview", "npy", "hdf5", "mat", "tdms"] | None = None
    separator: Literal[",", ";", "tab", "space"] | None = None
    decimal: Literal[".", ","] | None = None
    header_line: int | None = Field(default=None, ge=0, le=1000)
    units_row: bool | None = None
    encoding: str | None = None
    table: int | None = Field(default=None, ge=1)
    rate_hz: float | None = Field(default=None, gt=0.0, le=1e9)

    @model_validator(mode="after")
    def _is_told_apart(self) -> Self:
        if self.separator == self.decimal == ",":
            raise ValueError("separator and decimal cannot both be a comma")
        return self

    def layout(self) -> Layout:
        """What it says of a text."""
        return Layout(
            self.separator,
            self.decimal,
            self.header_line,
            self.units_row,
            self.encoding,
            self.table,
        )


class ColumnSaid(Section):
    """One column: SI = sign (cell - offset) gain, in `unit` times `gain_unit`.

    `name` is as in the file, with or without the unit behind it, or the number of the column from
    1. `index` is that of a column from 1, where the name is that of a table. `overrides_file`: the
    unit of the map counts where the file says another. `unwrap`: the range of a counter that begins
    again, in the file's numbers. `zero`: "linear" takes a straight line from the first to the last
    samples for zero. `outliers`: samples far outside the column's own noise, or without a number,
    are refused or left out.
    """

    name: str | int
    index: int | None = Field(default=None, ge=1)
    unit: str | None = None
    sign: Literal[1, -1] = 1
    offset: float = 0.0
    gain: float = 1.0
    gain_unit: str = ""
    overrides_file: bool = False
    unwrap: float | None = Field(default=None, gt=0.0)
    zero: Literal["as_said", "linear"] = "as_said"
    outliers: Literal["refuse", "leave_out"] = "refuse"


class Columns(Section):
    """The columns that a trial has."""

    lateral_force: ColumnSaid
    time: ColumnSaid | None = None
    normal_force: ColumnSaid | None = None
    voltage: ColumnSaid | None = None
    electrode_voltage: ColumnSaid | None = None
    position: ColumnSaid | None = None
    speed: ColumnSaid | None = None


class VoltageMark(Section):
    """When the voltage is on: between two times, or where a column exceeds a threshold.

    `bursts`: of a voltage that comes on several times "each" is a trial of its own. Where their
    levels differ, the set voltage is that of the highest.
    """

    bursts: Literal["one", "each"] = "one"
    column: Literal["voltage", "electrode_voltage"] | None = None
    threshold_v: float | None = Field(default=None, gt=0.0, le=1e5)
    start_s: Seconds | None = None
    end_s: Seconds | None = None

    @model_validator(mode="after")
    def _says_one(self) -> Self:
        if (self.column is None) == (self.start_s is None):
            raise ValueError("give either column or start_s")
        return self


class MotionMark(Section):
    """When the finger slides: between two times, or where it is fast enough.

    `turns`: "sign" counts the lateral force against the finger's way, where it turns in a window.
    """

    turns: Literal["refuse", "sign"] = "refuse"
    least_speed_m_s: float | None = Field(default=None, gt=0.0, le=10.0)
    start_s: Seconds | None = None
    end_s: Seconds | None = None


class Window(Section):
    """A stretch of time, counted from when the voltage comes on, goes off, or motion begins."""

    after: Literal["on", "off", "motion"] = "on"
    start_s: Seconds
    end_s: Seconds

    @model_validator(mode="after")
    def _is_some(self) -> Self:
        if self.end_s <= self.start_s:
            raise ValueError("end_s must be above start_s")
        return self


class Baseline(Window):
    """Friction before voltage.

    `use` has three values. "row": a row without voltage. "offset": the trial's own zero, cof =
    `cof` plus the rise of the lateral force since, over the load. "gain": the trial's own gain, cof
    = `cof` times friction over that before voltage.
    """

    use: Literal["row", "offset", "gain"] = "row"
    cof: float | None = Field(default=None, gt=0.0, le=10.0)

    @model_validator(mode="after")
    def _knows_its_friction(self) -> Self:
        if (self.use == "row") != (self.cof is None):
            raise ValueError('cof, friction without voltage, belongs to use = "offset" or "gain"')
        return self


class Conditions(Section):
    """What was set, by trial: from its file's name, from a table, or the same throughout.

    `patterns`: regular expressions for the file's name whose named groups are conditions. `table`:
    a CSV beside the map with a column `file` and columns named as conditions. `voltage_is`: how the
    set voltage counts; `voltage_scale`: the electrode's share of it.
    """

    patterns: tuple[str, ...] = Field(default=(), strict=False)
    table: str | None = None
    values: dict[str, float | str] = Field(default_factory=dict)
    units: dict[str, str] = Field(default_factory=dict)
    voltage_is: Literal["peak", "peak_to_peak", "rms"] = "peak"
    voltage_scale: float = Field(default=1.0, gt=0.0, le=1e5)

    @field_validator("patterns")
    @classmethod
    def _are_patterns(cls, patterns: tuple[str, ...]) -> tuple[str, ...]:
        for pattern in patterns:
            try:
                named = re.compile(pattern).groupindex
            except re.error as error:
                raise ValueError(f"'{pattern}' is no regular expression: {error}") from error
            if not named or not set(named) <= set(CONDITIONS):
                raise ValueError(f"'{pattern}' needs groups such as (?P<voltage>...)")
        return patterns

    @model_validator(mode="after")
    def _are_known(self) -> Self:
        for name in (*self.values, *self.units):
            if name not in CONDITIONS:
                raise ValueError(f"'{name}' is no condition; known: {', '.join(CONDITIONS)}")
        return self


class TrialMap(Section):
    """The whole map."""

    file: FileLook = FileLook()
    columns: Columns
    conditions: Conditions
    voltage_on: VoltageMark | None = None
    motion: MotionMark | None = None
    baseline: Baseline | None = None
    windows: tuple[Window, ...] = Field(min_length=1, strict=False)

    @model_validator(mode="after")
    def _has_what_it_names(self) -> Self:
        mark = self.voltage_on
        if mark is not None and mark.column and getattr(self.columns, mark.column) is None:
            raise ValueError(f"voltage_on.column: there is no [columns.{mark.column}]")
        anchors = {window.after for window in (*self.windows, *filter(None, (self.baseline,)))}
        if mark is None and anchors & {"on", "off"}:
            raise ValueError("windows count from the voltage, and [voltage_on] is missing")
        by_speed = self.motion is not None and self.motion.start_s is None
        if by_speed and self.columns.position is None and self.columns.speed is None:
            raise ValueError("[motion] needs start_s, or a column position or speed")
        if self.columns.time is None and self.file.rate_hz is None:
            raise ValueError("give [columns.time], or file.rate_hz")
        return self


def read_map(path: Path) -> TrialMap:
    """A map; BadInputError names every key at fault."""
    return parse(TrialMap, read_toml(path), str(path), "bad_map")


def made_map(values: Mapping[str, Any]) -> TrialMap:
    """A map that is given as a dict; BadInputError names every key at fault."""
    return parse(TrialMap, dict(values), "the map", "bad_map")
