"""Measurement plans: which settings are measured, how often, in which order, for how long."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from itertools import product
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple, Self

import numpy as np
from pydantic import (
    AfterValidator,
    BeforeValidator,
    Field,
    FiniteFloat,
    SkipValidation,
    model_validator,
)

from haptic_driver.config import Section, find_config, parse
from haptic_driver.errors import BadInputError
from haptic_driver.files import write_text
from model.conditions import UNDRIVEN_HZ
from model.effects.interventions import BY_INTERVENTION, NOTHING
from model.support.errors import nearest
from model.support.reading import read_toml
from model.support.toml import toml_lines

MOST_ROWS = 100_000
LONGEST_S = 86400.0  # of a session


# One number or a list of them.
_SOME = (
    Field(min_length=1),
    BeforeValidator(lambda value: value if isinstance(value, list) else [value]),
)
Frequencies = Annotated[list[Annotated[FiniteFloat, Field(ge=1e-3, le=20e6)]], *_SOME]
Voltages = Annotated[list[Annotated[FiniteFloat, Field(ge=0.0, le=1000.0)]], *_SOME]
Loads = Annotated[list[Annotated[FiniteFloat, Field(ge=0.01, le=20.0)]], *_SOME]
Speeds = Annotated[list[Annotated[FiniteFloat, Field(ge=1e-4, le=1.0)]], *_SOME]
Offsets = Annotated[list[Annotated[FiniteFloat, Field(ge=-1000.0, le=1000.0)]], *_SOME]
Waveforms = Annotated[list[Literal["sine", "square", "dc"]], *_SOME]
Times = Annotated[list[Annotated[FiniteFloat, Field(ge=0.0, le=LONGEST_S)]], *_SOME]
Fingers = Annotated[list[Literal["sliding", "resting", "none"]], *_SOME]


def _spread(value: object) -> object:
    """`{ low, high, per_decade }` as a list, evenly spaced on a logarithmic axis, to three
    digits.
    """
    if not isinstance(value, dict):
        return value
    band = _Band.model_validate(value)
    count = round(np.log10(band.high / band.low) * band.per_decade) + 1
    return [float(f"{f:.3g}") for f in np.geomspace(band.low, band.high, count)]


class _Band(Section):
    """Frequencies by their ends, Hz."""

    low: Annotated[FiniteFloat, Field(ge=1e-3, le=20e6)]
    high: Annotated[FiniteFloat, Field(ge=1e-3, le=20e6)]
    per_decade: Annotated[int, Field(ge=1, le=50)]

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if self.low >= self.high:
            raise ValueError("low must be below high")
        return self


class _Block(Section):
    """Levels whose every combination is measured."""

    frequency_hz: Frequencies
    voltage_v: Voltages
    normal_force_n: Loads
    speed_m_s: Speeds
    voltage_offset_v: Offsets = [0.0]  # noqa: RUF012 - pydantic copies it
    waveform: Waveforms = ["sine"]  # noqa: RUF012
    time_s: Times | None = None


class Sweep(Section):
    """A spectrum of the electrode's voltage and current at a few volts, without friction.

    Every load and speed is swept for each of `finger`: `sliding` at each speed, `resting`, or
    `none`, the open circuit that calibrates the stray capacitance. `voltage_v` is the highest; less
    where the rig's limits ask for it.
    """

    frequency_hz: Annotated[Frequencies, BeforeValidator(_spread)] = Field(
        description=(
            "a list, or `{ low, high, per_decade }` to be spread evenly on a logarithmic axis"
        )
    )
    voltage_v: Annotated[FiniteFloat, Field(gt=0.0, le=100.0)] = Field(
        default=5.0, description="the highest; less where the rig's limits ask for it"
    )
    normal_force_n: Loads = Field(default=[0.5], description="one number or a list")
    speed_m_s: Speeds = Field(default=[0.02], description="one number or a list")
    finger: Fingers = Field(
        default=["resting", "sliding"], description="one or a list; `none` is the open circuit"
    )

    def settings(self) -> Iterator[Setting]:
        """One spectrum after the other."""
        for finger in self.finger:
            loads_n = [0.0] if finger == "none" else self.normal_force_n
            speeds_m_s = self.speed_m_s if finger == "sliding" else [0.0]
            for load_n, speed_m_s, f in product(loads_n, speeds_m_s, self.frequency_hz):
                yield Setting(f, self.voltage_v, load_n, speed_m_s, finger=finger, sweep=True)


def _known_intervention(name: str) -> str:
    known = [NOTHING, *BY_INTERVENTION]
    if name not in known:
        raise ValueError(f"'{name}' is no intervention: {nearest(name, known)}")
    return name


class _Procedure(Section):
    """How settings are measured: a row settles, is averaged, and is over after a pause."""

    name: str = Field(description="written into the data file")
    about: str = Field(default="", description="in words")
    repeats: Annotated[int, Field(ge=1, le=1000)] = Field(
        default=1, description="of every setting in each session"
    )
    sessions: Annotated[int, Field(ge=1, le=1000)] = Field(
        default=1, description="how often all of it is measured"
    )
    randomise: bool = Field(default=True, description="a random order, the same for the same seed")
    seed: Annotated[int, Field(ge=0)] = Field(
        default=1, description="of the order and, on a simulated rig, of the noise"
    )
    voltage_off_every: Annotated[int, Field(ge=0)] = Field(
        default=0, description="a row without voltage before every so many rows; 0: none"
    )
    settle_s: Annotated[FiniteFloat, Field(ge=0.1, le=600.0)] = Field(
        default=0.75, description="before friction is averaged"
    )
    average_s: Annotated[FiniteFloat, Field(ge=0.25, le=60.0)] = Field(
        default=1.0, description="over which friction is averaged"
    )
    pause_s: Annotated[FiniteFloat, Field(ge=0.0, le=3600.0)] = Field(
        default=1.0, description="with the finger lifted, after every row"
    )
    load_tolerance: Annotated[FiniteFloat, Field(ge=0.01, le=1.0)] = Field(
        default=0.1, description="a share of the load by which the mean of a row may miss it"
    )
    intervention: Annotated[str, AfterValidator(_known_intervention)] = Field(
        default=NOTHING,
        description=(
            "what somebody does at the rig before the first row, and keeps up ([what "
            "removes what](investigation.md))"
        ),
    )


class PlanFile(_Procedure):
    """A plan as its file says; each of `points` is a block, with the lists of the file for what it
    does not say.

    With `time_s` a setting is measured at these times of each session, otherwise in the order's own
    time.
    """

    frequency_hz: Frequencies | None = Field(
        default=None, description="one number or a list of them"
    )
    voltage_v: Voltages | None = Field(
        default=None, description="one number or a list; 0 is friction without voltage"
    )
    normal_force_n: Loads | None = Field(default=None, description="one number or a list")
    speed_m_s: Speeds | None = Field(default=None, description="one number or a list")
    voltage_offset_v: Offsets | None = Field(
        default=None, description="a bias beside the amplitude; one number or a list"
    )
    waveform: Waveforms | None = Field(
        default=None, description="one or a list; `dc` is a direct voltage of `voltage_v`"
    )
    time_s: Times | None = Field(
        default=None,
        description=(
            "when in its session the middle of a row's window lies; left out: whenever its turn is"
        ),
    )
    points: Annotated[list[dict[str, Any]], Field(min_length=1)] | None = Field(
        default=None,
        description="blocks of levels; each takes the lists above for what it does not say",
    )
    sweep: list[Sweep] = []  # noqa: RUF012

    def blocks(self) -> list[dict[str, Any]]:
        """What the file says of each block; a file that has only sweeps has none."""
        if self.points is not None:
            return self.points
        return [] if self.sweep and self.frequency_hz is None else [{}]


class Setting(NamedTuple):
    """What is set for one row; `voltage_v` 0 is friction without voltage, its frequency is 0 and
    means nothing.

    A `sweep` measures no friction. `time_s` is when in its session the row is wanted, None for
    whenever; `intervention` what has been done at the rig before. `by_meter`: an instrument drives
    the electrode, the amplifier stays off.
    """

    frequency_hz: float
    voltage_v: float
    normal_force_n: float
    speed_m_s: float
    voltage_offset_v: float = 0.0
    waveform: str = "sine"
    finger: str = "sliding"
    sweep: bool = False
    time_s: float | None = None
    by_meter: bool = False
    intervention: str = NOTHING

    @property
    def driven(self) -> bool:
        """Whether there is a voltage."""
        return self.voltage_v > 0.0 or self.voltage_offset_v != 0.0

    @property
    def peak_v(self) -> float:
        if self.waveform == "dc":
            return abs(self.voltage_v + self.voltage_offset_v)
        return self.voltage_v + abs(self.voltage_offset_v)

    def without_voltage(self) -> Setting:
        """The same load and speed with the output off."""
        return Setting(
            0.0,
            0.0,
            self.normal_force_n,
            self.speed_m_s,
            time_s=self.time_s,
            intervention=self.intervention,
        )


class Row(NamedTuple):
    """One row to measure; `session` and `trial` (occurrence of this setting in the session) count
    from 1.
    """

    setting: Setting
    session: int
    trial: int


class Plan(_Procedure):
    """What to measure, and how."""

    settings: SkipValidation[tuple[Setting, ...]]

    def rows(self, settings: Sequence[Setting], seed: int) -> list[Row]:
        """The order of measurement of `settings`, session by session, the same for the same seed.

        Sweeps come last, one spectrum after the other; what has a time comes when that is due.
        """
        ordered: list[Row] = []
        sweeps = [s for s in settings if s.sweep] * self.repeats
        timed = sorted(
            [s for s in settings if s.time_s is not None] * self.repeats,
            key=lambda s: s.time_s or 0.0,
        )
        others = [s for s in settings if not s.sweep and s.time_s is None]
        for session in range(1, self.sessions + 1):
            todo = others * self.repeats
            if self.randomise:
                todo = [
                    todo[i] for i in np.random.default_rng([seed, session]).permutation(len(todo))
                ]
            trials: Counter[Setting] = Counter()
            for setting in self._timely(timed, [*self._with_voltage_off(todo), *sweeps]):
                trials[setting] += 1
                ordered.append(Row(setting, session, trials[setting]))
        return ordered

    @property
    def row_s(self) -> float:
        """How long a row takes, apart from bringing up the voltage."""
        return self.settle_s + self.average_s + self.pause_s

    def _timely(self, timed: Sequence[Setting], others: Sequence[Setting]) -> list[Setting]:
        """Rows with a time among the others: before the first that would make them late."""
        order: list[Setting] = []
        waiting, clock_s = list(timed), 0.0
        for setting in others:
            while waiting and self.begin_s(waiting[0]) < clock_s + self.row_s:
                clock_s = max(clock_s, self.begin_s(waiting[0])) + self.row_s
                order.append(waiting.pop(0))
            clock_s += self.row_s
            order.append(setting)
        return order + waiting

    def begin_s(self, setting: Setting) -> float:
        """When in its session a row with a time begins, so that the middle of its window lies
        there.
        """
        return (setting.time_s or 0.0) - self.settle_s - 0.5 * self.average_s

    def _with_voltage_off(self, todo: list[Setting]) -> list[Setting]:
        """A row without voltage, at the load and speed of the row that follows, before every so
        many rows.
        """
        if not self.voltage_off_every:
            return todo
        inserted: list[Setting] = []
        for i, setting in enumerate(todo):
            inserted += [setting.without_voltage()] if i % self.voltage_off_every == 0 else []
            inserted.append(setting)
        return inserted


def load_plan(name_or_path: str) -> Plan:
    """A plan by the name of its file in `configs/plans/`, or by path; BadInputError says what is
    wrong where.
    """
    path = find_config(name_or_path, "plans")
    file = parse(PlanFile, read_toml(path), str(path))
    settings: dict[Setting, None] = {}
    shared = file.model_dump(include=set(_Block.model_fields), exclude_none=True)
    for number, block in enumerate(file.blocks(), start=1):
        where = f"{path}, [[points]] {number}" if file.points is not None else str(path)
        settings |= dict.fromkeys(_settings(parse(_Block, shared | block, where)))
    settings |= dict.fromkeys(setting for sweep in file.sweep for setting in sweep.settings())
    if not settings:
        raise BadInputError(
            "bad_config", f"{path}: the plan measures nothing", "Give [[points]] or [[sweep]]"
        )
    count = len(settings) * file.repeats * file.sessions
    if count > MOST_ROWS:
        raise BadInputError(
            "bad_config", f"{path}: the plan has {count} rows", f"At most {MOST_ROWS} are measured"
        )
    rest = file.model_dump(exclude={"points", "sweep", *_Block.model_fields})
    return Plan(
        settings=tuple(s._replace(intervention=file.intervention) for s in settings), **rest
    )


def _settings(levels: _Block) -> Iterator[Setting]:
    """Every combination of a block; a direct voltage has no frequency."""
    times: Sequence[float | None] = levels.time_s or [None]
    every = product(
        levels.frequency_hz,
        levels.voltage_v,
        levels.normal_force_n,
        levels.speed_m_s,
        levels.voltage_offset_v,
        levels.waveform,
        times,
    )
    for f, v, n, s, offset_v, waveform, time_s in every:
        frequency_hz = 0.0 if waveform == "dc" else float(f)
        setting = Setting(
            frequency_hz, float(v), float(n), float(s), float(offset_v), waveform, time_s=time_s
        )
        yield setting if setting.driven else setting.without_voltage()


def write_plan(path: Path, plan: Plan) -> None:
    """A plan's file with its settings as they stand, which `load_plan` reads; HapticError when it
    cannot be written.
    """
    head = plan.model_dump(exclude={"settings"}, exclude_defaults=True)
    parts = [toml_lines(head)]
    for setting in plan.settings:
        told = setting._asdict() | {"frequency_hz": setting.frequency_hz or UNDRIVEN_HZ}
        del told["intervention"]  # the plan's
        if setting.sweep:
            kind = "sweep"
            told = {key: told[key] for key in Sweep.model_fields if told[key]}
        else:
            kind = "points"
            told = {
                key: value
                for key, value in told.items()
                if value != Setting._field_defaults.get(key)
            }
        parts.append(f"[[{kind}]]\n{toml_lines(told)}")
    write_text(path, "\n".join(parts))
