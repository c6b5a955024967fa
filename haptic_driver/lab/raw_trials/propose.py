"""The look of a file -> what every column is, and a map to complete, without inventions."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import isnan, nan, sqrt
from pathlib import Path

import numpy as np

from haptic_driver.errors import BadInputError
from haptic_driver.lab.force_signal import FEWEST
from haptic_driver.lab.raw_trials.columns import NO_TABLES, Column, Source, open_columns
from haptic_driver.lab.raw_trials.cut import on_stretches
from haptic_driver.lab.raw_trials.look import Span, without_load
from haptic_driver.lab.raw_trials.quantities import Quantities, unit_said
from haptic_driver.lab.raw_trials.trial_map import FileLook, VoltageMark
from haptic_driver.signals import Array
from model.support.toml import toml_value
from model.support.units import of_kind, to_si

TODO = '"TODO"'
ROLES = {  # names that labs give, in the order in which roles are given away
    "time": r"^(t|time|zeit|x_value|timestamp)\b|time",
    "normal_force": r"^f_?z\b|^f_?n\b|normal|load",
    "lateral_force": r"^f_?[xyt]\b|lateral|tangential|friction|shear|^force\b",
    "electrode_voltage": r"hv|mon|electrode",
    "voltage": r"^[uv]\b|volt|trigger|drive|spannung",
    "position": r"^[xsp]\b|^pos|position|stage|displacement|^weg\b",
    "speed": r"speed|velocity|geschwindigkeit",
}
IN_NAMES = ("voltage", "frequency", "normal_force", "speed")
SENSOR = ("V", "mV")  # what a sensor of any quantity may give


@dataclass(frozen=True)
class Seen:
    """A column as it was found: unit and where it is said, range, noise from sample to sample.

    `role` is what it is taken for, empty for nothing. All in the file's numbers.
    """

    name: str
    unit: str
    unit_from: str
    low: float
    high: float
    noise: float
    role: str


@dataclass(frozen=True)
class Proposal:
    """What a file seems to be: its columns, the rate by its time, a map, and a picture's content.

    `drawn`: columns [n] by role in SI, those of `as_written` in the file's numbers: no unit is
    known.
    """

    seen: list[Seen]
    rate_hz: float | None
    map_text: str
    drawn: Mapping[str, Array]
    as_written: frozenset[str]
    voltage: tuple[Span, ...]
    spans: tuple[Span, ...]
    taken: list[str]


def proposed(path: Path, look: FileLook | None = None) -> Proposal:
    """What files like this one seem to be; BadInputError for one without columns of numbers."""
    look = look or FileLook()
    source = open_columns(path, look)
    if not source.columns:
        said = f"{path}: has no columns of numbers"
        raise BadInputError(
            "bad_trial", said, NO_TABLES if path.suffix == ".mat" else "Is it whole?"
        )
    taken = _taken(source)
    drawn = {role: one.in_si() for role, one in taken.items()}
    stretches = _stretches(path, drawn, source)
    spans = _spans(drawn, stretches)
    roles = {id(one.column): role for role, one in taken.items()}
    seen = [_seen(column, roles.get(id(column), "")) for column in source.columns]
    text = "\n".join(
        [
            f"# Proposed from {path.name}: look at every line, and fill in each TODO.",
            *_file_lines(source, look, taken),
            *(line for role, one in taken.items() for line in one.lines(role)),
            *(
                []
                if "lateral_force" in taken
                else ["", "[columns.lateral_force]", f"name = {TODO}"]
            ),
            *_conditions(path),
            *_windows(drawn, stretches, spans),
        ]
    )
    as_written = frozenset(role for role, one in taken.items() if not one.has_unit)
    told = _said(taken, drawn)
    return Proposal(seen, _rate_hz(taken), text + "\n", drawn, as_written, stretches, spans, told)


@dataclass(frozen=True)
class _Taken:
    """A column that is taken for a role, its values [n] in the file's numbers, and its sign."""

    column: Column
    role: str
    values: Array
    sign: int

    @property
    def unit(self) -> str:
        return unit_said(self.role, self.column)[0]

    @property
    def has_unit(self) -> bool:
        """Whether one of the role is known."""
        return self.role in of_kind(self.unit)

    def in_si(self) -> Array:
        """In SI where a unit is known, else in the file's numbers."""
        factor = to_si(self.role, self.unit, self.role) if self.has_unit else 1.0
        return self.sign * factor * self.values

    def lines(self, role: str) -> list[str]:
        """Its section of a map."""
        lines = ["", f"[columns.{role}]", f"name = {toml_value(self.column.name)}"]
        lines += [] if self.column.index is None else [f"index = {self.column.index}"]
        unit = toml_value(self.unit) if self.unit else f"{TODO}  # nothing says it"
        lines.append(f"unit = {unit}")
        if "force" in role and self.unit in SENSOR:
            lines += [f"gain = {TODO}  # of the sensor", 'gain_unit = "N/V"']
        return [*lines, "sign = -1  # most of it is negative"] if self.sign < 0 else lines


def _taken(source: Source) -> dict[str, _Taken]:
    roles = roles_of([c.name for c in source.columns], [c.unit for c in source.columns])
    taken = {}
    for role, at in roles.items():
        values = source.columns[at].read()
        is_negative = "force" in role and np.nanmedian(values) < 0.0
        taken[role] = _Taken(source.columns[at], role, values, -1 if is_negative else 1)
    return taken


def roles_of(names: Sequence[str], units: Sequence[str]) -> dict[str, int]:
    """Which column is likely to be what, from 0: by name, and not against its unit."""
    found: dict[str, int] = {}
    for role, pattern in ROLES.items():
        for i, (name, unit) in enumerate(zip(names, units, strict=True)):
            fits = not unit or role in of_kind(unit) or (unit in SENSOR and role != "time")
            bare = re.split(r"[/.:]", name.lower())[-1].replace("_", " ")
            if i not in found.values() and fits and re.search(pattern, bare):
                found[role] = i
                break
    return found


def in_name(path: Path) -> dict[str, tuple[str, str]]:
    """Patterns and units of the quantities in a file's name, as 120V or 0p5N."""
    found: dict[str, tuple[str, str]] = {}
    # no tail of another number, as in 1e3Hz, 1e-3Hz, 1k5Hz or 2-5kHz
    number = r"(?<!\d)(?<!\d[A-Za-z.,-])(?<!\d[eE][-+])\d+(?:[.,p]\d+)?"
    for match in re.finditer(rf"({number})([A-Za-zµ]+)(?=[_\-. ]|$)", path.stem):
        kinds = [kind for kind in of_kind(match[2]) if kind in IN_NAMES and kind not in found]
        if kinds:
            end = "(?![A-Za-z])"
            found[kinds[0]] = (rf"(?P<{kinds[0]}>{number}){re.escape(match[2])}{end}", match[2])
    for name, words in (("session", "day|session|s"), ("trial", "trial|run|rep|r|t")):
        numbered = re.search(rf"(?:^|_)({words})(\d+)(?=_|$)", path.stem)
        if numbered:
            found[name] = (rf"(?:^|_){numbered[1]}(?P<{name}>\d+)", "")
    return found


def _seen(column: Column, role: str) -> Seen:
    values = column.read()
    values = values[np.isfinite(values)]
    if values.size < 2:
        return Seen(column.name, column.unit, column.unit_from, nan, nan, nan, role)
    unit, unit_from = unit_said(role, column) if role else (column.unit, column.unit_from)
    noise = (
        1.5 * float(np.median(np.abs(np.diff(values, 2)))) / sqrt(6.0) if values.size > 2 else nan
    )
    name = column.name if column.index is None else f"{column.name}, index {column.index}"
    return Seen(name, unit, unit_from, float(values.min()), float(values.max()), noise, role)


def _rate_hz(taken: Mapping[str, _Taken]) -> float | None:
    """The rate of samples, where a column of time says its unit."""
    if "time" not in taken or not taken["time"].unit:
        return None
    step_s = float(np.nanmedian(np.diff(taken["time"].in_si())))
    return 1.0 / step_s if step_s > 0.0 else None


def _stretches(path: Path, drawn: Mapping[str, Array], source: Source) -> tuple[Span, ...]:
    """When the voltage is on, where a column and the time tell it."""
    column = next((name for name in ("voltage", "electrode_voltage") if name in drawn), None)
    if column is None or "time" not in drawn or not np.nanmax(np.abs(drawn[column])):
        return ()
    mark = VoltageMark.model_validate({"column": column})
    try:
        return tuple(on_stretches(Quantities(path, drawn, {}, source.lines), mark, 0.0)[0])
    except BadInputError:
        return ()


def _spans(drawn: Mapping[str, Array], stretches: Sequence[Span]) -> tuple[Span, ...]:
    """Stretches before and while the voltage is on, away from where it changes.

    They hold for each time that it is on: by the shortest of them and of the pauses before.
    """
    if not stretches:
        return ()
    on = stretches[0]
    begins_s = [float(drawn["time"][0]), *(each.end_s for each in stretches)]
    before_s = min(s.start_s - at for s, at in zip(stretches, begins_s, strict=False))
    on_s = min(each.end_s - each.start_s for each in stretches)
    window = Span("window 1", on.start_s + 0.3 * on_s, on.start_s + 0.9 * on_s)
    if before_s <= 0.0:
        return (window,)
    return (Span("baseline", on.start_s - 0.7 * before_s, on.start_s - 0.1 * before_s), window)


def _said(taken: Mapping[str, _Taken], drawn: Mapping[str, Array]) -> list[str]:
    """What the picture takes each thing for."""
    said = [
        f"{role}: column {one.column.name}{'' if one.has_unit else ', no unit'}"
        for role, one in taken.items()
    ]
    said += [f"sign of {role}: -1, most is negative" for role, one in taken.items() if one.sign < 0]
    if {"normal_force", "lateral_force"} <= set(drawn):
        free = without_load(drawn["normal_force"])
        if free.sum() >= FEWEST:
            zero = float(np.nanmedian(drawn["lateral_force"][free]))
            said.append(f"zero of lateral_force: {zero:.3g} without load")
    return said


def _file_lines(source: Source, look: FileLook, taken: Mapping[str, _Taken]) -> list[str]:
    lines = ["[file]"]
    text = source.text
    if look.kind:
        lines.append(f"kind = {toml_value(look.kind)}")
    if text is not None and not text.is_labview:
        lines += [f"separator = {toml_value(text.separator)}"]
        lines += ["units_row = true"] if text.units_row else []
    if "time" not in taken:
        lines.append(f"rate_hz = {TODO}  # no column of time was found")
    return lines


def _conditions(path: Path) -> list[str]:
    found = in_name(path)
    patterns = ", ".join(f"'{pattern}'" for pattern, _ in found.values())
    units = ", ".join(f"{name} = {toml_value(unit)}" for name, (_, unit) in found.items() if unit)
    missing = [name for name in ("voltage", "frequency") if name not in found]
    lines = ["", "[conditions]", f"patterns = [{patterns}]", f"units = {{ {units} }}"]
    if missing:
        values = ", ".join(f"{name} = {TODO}" for name in missing)
        lines.append(f"values = {{ {values} }}  # the file's name does not say it; units too")
    if found.get("voltage", ("", "V"))[1] == "V":
        lines.append(f"voltage_is = {TODO}  # peak, peak_to_peak or rms")
    return lines


def _windows(
    drawn: Mapping[str, Array], stretches: Sequence[Span], spans: Sequence[Span]
) -> list[str]:
    column = next((name for name in ("voltage", "electrode_voltage") if name in drawn), None)
    lines = ["", "[voltage_on]"]
    lines.append(f"column = {toml_value(column)}" if column else f"start_s = {TODO}  # it comes on")
    if len(stretches) > 1:
        lines.append(f'bursts = "each"  # it comes on {len(stretches)} times')
    lines += ["", "[motion]"] if {"position", "speed"} & set(drawn) else []
    zero_s = stretches[0].start_s if stretches else 0.0
    for span in spans or (Span("window 1", nan, nan),):
        head = "[baseline]  # friction before the voltage" if span.name == "baseline" else ""
        lines += ["", head or "[[windows]]"]
        for key, at_s in (("start_s", span.start_s), ("end_s", span.end_s)):
            lines.append(f"{key} = {TODO if isnan(at_s) else f'{at_s - zero_s:.3g}'}")
    return lines
