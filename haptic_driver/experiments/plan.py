"""Measurement plans: which settings are measured, how often, in which order, for how long."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Sequence
from itertools import product
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import numpy as np
from pydantic import BeforeValidator, Field, FiniteFloat, SkipValidation

from haptic_driver.config import Section, find_config, parse, read_toml
from haptic_driver.errors import BadInputError
from haptic_driver.files import write_text
from model.conditions import UNDRIVEN_HZ

MOST_ROWS = 100_000


# One number or a list of them.
_SOME = (Field(min_length=1), BeforeValidator(lambda value: value if isinstance(value, list) else [value]))
Frequencies = Annotated[list[Annotated[FiniteFloat, Field(ge=1e-3, le=20e6)]], *_SOME]
Voltages = Annotated[list[Annotated[FiniteFloat, Field(ge=0.0, le=1000.0)]], *_SOME]
Loads = Annotated[list[Annotated[FiniteFloat, Field(ge=0.01, le=20.0)]], *_SOME]
Speeds = Annotated[list[Annotated[FiniteFloat, Field(ge=1e-4, le=1.0)]], *_SOME]


class _Block(Section):
    """Levels whose every combination is measured."""

    frequency_hz: Frequencies
    voltage_v: Voltages
    normal_force_n: Loads
    speed_m_s: Speeds


class _Procedure(Section):
    """How settings are measured. `voltage_off_every` n: a row without voltage before every n rows; 0 for none.

    A row lasts `settle_s`, then `average_s` over which friction is averaged, then `pause_s` with the finger lifted.
    `load_tolerance` is the share of its load by which a row's mean may miss it.
    """

    name: str
    about: str = ""
    repeats: Annotated[int, Field(ge=1, le=1000)] = 1
    sessions: Annotated[int, Field(ge=1, le=1000)] = 1
    randomise: bool = True
    seed: Annotated[int, Field(ge=0)] = 1
    voltage_off_every: Annotated[int, Field(ge=0)] = 0
    settle_s: Annotated[FiniteFloat, Field(ge=0.1, le=600.0)] = 0.75
    average_s: Annotated[FiniteFloat, Field(ge=0.25, le=60.0)] = 1.0
    pause_s: Annotated[FiniteFloat, Field(ge=0.0, le=3600.0)] = 1.0
    load_tolerance: Annotated[FiniteFloat, Field(ge=0.01, le=1.0)] = 0.1


class PlanFile(_Procedure):
    """A plan as its file says; each of `points` is a block, with the lists of the file for what it does not say."""

    frequency_hz: Frequencies | None = None
    voltage_v: Voltages | None = None
    normal_force_n: Loads | None = None
    speed_m_s: Speeds | None = None
    points: Annotated[list[dict[str, Any]], Field(min_length=1)] = [{}]  # noqa: RUF012 - pydantic copies it


class Setting(NamedTuple):
    """What is set for one row; `voltage_v` 0 is friction without voltage, its frequency is 0 and means nothing."""

    frequency_hz: float
    voltage_v: float
    normal_force_n: float
    speed_m_s: float

    def without_voltage(self) -> Setting:
        """The same load and speed with the output off."""
        return Setting(0.0, 0.0, self.normal_force_n, self.speed_m_s)


class Row(NamedTuple):
    """One row to measure; `session` and `trial` (occurrence of this setting in the session) count from 1."""

    setting: Setting
    session: int
    trial: int


class Plan(_Procedure):
    """What to measure, and how."""

    settings: SkipValidation[tuple[Setting, ...]]

    def rows(self, settings: Sequence[Setting], seed: int) -> list[Row]:
        """The order of measurement of `settings`, session by session, the same for the same seed."""
        ordered: list[Row] = []
        for session in range(1, self.sessions + 1):
            todo = list(settings) * self.repeats
            if self.randomise:
                todo = [todo[i] for i in np.random.default_rng([seed, session]).permutation(len(todo))]
            trials: Counter[Setting] = Counter()
            for setting in self._with_voltage_off(todo):
                trials[setting] += 1
                ordered.append(Row(setting, session, trials[setting]))
        return ordered

    def _with_voltage_off(self, todo: list[Setting]) -> list[Setting]:
        """A row without voltage, at the load and speed of the row that follows, before every so many rows."""
        if not self.voltage_off_every:
            return todo
        inserted: list[Setting] = []
        for i, setting in enumerate(todo):
            inserted += [setting.without_voltage()] if i % self.voltage_off_every == 0 else []
            inserted.append(setting)
        return inserted


def load_plan(name_or_path: str) -> Plan:
    """A plan by the name of its file in `configs/plans/`, or by path; BadInputError says what is wrong where."""
    path = find_config(name_or_path, "plans")
    file = parse(PlanFile, read_toml(path), str(path))
    settings: dict[Setting, None] = {}
    shared = file.model_dump(include=set(_Block.model_fields), exclude_none=True)
    for number, block in enumerate(file.points, start=1):
        where = f"{path}, [[points]] {number}" if "points" in file.model_fields_set else str(path)
        levels = parse(_Block, shared | block, where)
        for f, v, n, s in product(levels.frequency_hz, levels.voltage_v, levels.normal_force_n, levels.speed_m_s):
            setting = Setting(float(f), float(v), float(n), float(s))
            settings[setting if v > 0.0 else setting.without_voltage()] = None
    count = len(settings) * file.repeats * file.sessions
    if count > MOST_ROWS:
        raise BadInputError("bad_config", f"{path}: the plan has {count} rows", f"At most {MOST_ROWS} are measured")
    rest = file.model_dump(exclude={"points", *_Block.model_fields})
    return Plan(settings=tuple(settings), **rest)


def write_plan(path: Path, name: str, about: str, settings: Sequence[Setting], repeats: int) -> None:
    """A plan's file with `settings` as they stand, which `load_plan` reads; HapticError when it cannot be written."""
    lines = [f"name = {json.dumps(name)}", f"about = {json.dumps(about)}", f"repeats = {repeats}"]
    for setting in settings:
        frequency_hz = setting.frequency_hz if setting.voltage_v > 0.0 else UNDRIVEN_HZ
        lines += [
            "",
            "[[points]]",
            *(f"{key} = {value}" for key, value in setting._replace(frequency_hz=frequency_hz)._asdict().items()),
        ]
    write_text(path, "\n".join(lines) + "\n")
