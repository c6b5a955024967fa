"""The look of a text file -> a map to correct; of other files, their columns."""

from __future__ import annotations

import json
import re
from dataclasses import dataclass
from pathlib import Path

from haptic_driver.errors import BadInputError
from haptic_driver.experiments.raw_trials.columns import (
    HEADER_LINES,
    LABVIEW_END,
    cells_of,
    decoded,
    kind_of,
    named_unit,
)
from haptic_driver.experiments.raw_trials.trial_map import FileLook
from haptic_driver.experiments.raw_trials.units import of_kind, understood
from model.support.cells import is_number

SURE = 5  # lines of numbers after which a table is believed
SEPARATORS = (";", "tab", ",", "space")
ROLES = {  # names that labs give, in the order in which roles are given away
    "time": r"^(t|time|zeit|x_value|timestamp)\b|time",
    "normal_force": r"^f_?z\b|^f_?n\b|normal|load",
    "lateral_force": r"^f_?[xyt]\b|lateral|tangential|friction|shear|^force\b",
    "electrode_voltage": r"hv|mon|electrode",
    "voltage": r"^[uv]\b|volt|trigger|drive",
    "position": r"^[xsp]\b|^pos|position|stage|displacement",
    "speed": r"speed|velocity",
}
IN_NAMES = ("voltage", "frequency", "normal_force", "speed")


@dataclass(frozen=True)
class Look:
    """How a text is written; `header_line` from 1, 0 where there is none."""

    separator: str
    decimal: str
    header_line: int
    units_row: bool
    names: list[str]
    units: list[str]


def look_of(lines: list[str]) -> Look:
    """Separator, decimal sign and header of a text; BadInputError where no table is found."""
    for separator in SEPARATORS:
        for decimal in (".", ",") if separator != "," else (".",):
            first = _first_line(lines, separator, decimal)
            if first is not None:
                return _with_header(lines, separator, decimal, first)
    said = f"no {SURE} lines of numbers follow one another"
    raise BadInputError("bad_trial", said, "Is it a text? Write its map by hand: docs/own-data.md")


def _first_line(lines: list[str], separator: str, decimal: str) -> int | None:
    """Where at least SURE lines of as many numbers begin, two or more each."""
    widths = []
    for line in lines[: HEADER_LINES + SURE]:
        cells = [c for c in cells_of(line, separator) if c]
        numbers = [is_number(c.replace(decimal, ".") if "." not in c else c) for c in cells]
        whole = decimal == "." or not any("." in c for c in cells)
        widths.append(len(cells) if len(cells) > 1 and all(numbers) and whole else 0)
    for i in range(len(widths) - SURE + 1):
        if widths[i] and len(set(widths[i : i + SURE])) == 1:
            return i
    return None


def _with_header(lines: list[str], separator: str, decimal: str, first: int) -> Look:
    width = len([c for c in cells_of(lines[first], separator) if c])
    above = [
        (i, cells)
        for i in range(max(first - 3, 0), first)
        if len(cells := cells_of(lines[i], separator)) >= width
    ]
    units_row = len(above) > 1 and all(
        understood(c.strip("[]() ")) is not None for c in above[-1][1] if c.strip("[]() ")
    )
    header = above[-2 if units_row else -1] if above else (-1, [])
    units = [c.strip("[]() ") for c in above[-1][1]] if units_row else []
    names = [named_unit(name)[0] for name in header[1]]
    if not units:
        units = [named_unit(name)[1] for name in header[1]]
    return Look(separator, decimal, header[0] + 1, units_row, names, units)


def roles_of(names: list[str], units: list[str]) -> dict[str, int]:
    """Which column is likely to be what, from 0: by name, and not against its unit."""
    found: dict[str, int] = {}
    for role, pattern in ROLES.items():
        for i, name in enumerate(names):
            unit = units[i] if i < len(units) else ""
            fits = not unit or role in of_kind(unit) or unit in ("V", "mV")
            if i not in found.values() and fits and re.search(pattern, name.lower()):
                found[role] = i
                break
    return found


def in_name(path: Path) -> dict[str, tuple[str, str]]:
    """Patterns and units of the quantities in a file's name, as 120V or 0p5N."""
    found: dict[str, tuple[str, str]] = {}
    number = r"\d+(?:[.,p]\d+)?"
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


def proposed(path: Path) -> str:
    """A map for files like this one, with what has to be looked at marked."""
    kind = kind_of(path, FileLook())
    if kind not in ("text", "labview"):
        said = f"{path}: a map is proposed for texts; the names in a {kind} file are its owner's"
        raise BadInputError("bad_ending", said, "Write its map by hand: docs/own-data.md")
    lines = decoded(path, "utf-8-sig")
    look = look_of(lines)
    roles = roles_of(look.names, look.units)
    if "lateral_force" not in roles:
        roles["lateral_force"] = len(look.names)
    text = ["# Proposed from " + path.name + ": look at every line.", "[file]"]
    if kind == "labview" or any(line.startswith(LABVIEW_END) for line in lines[:HEADER_LINES]):
        text.append('kind = "labview"')
    else:
        text += [f"separator = {_quoted(look.separator)}", f"decimal = {_quoted(look.decimal)}"]
        if look.units_row:
            text.append("units_row = true")
    for role, at in roles.items():
        text += _column(role, at, look)
        if "force" in role and _is_negative(lines, look, at):
            text.append("sign = -1  # most of it is negative")
    if "time" not in roles:
        text.insert(2, "rate_hz = 1000.0  # TODO: no column of time was found")
    return "\n".join([*text, *_conditions(path), *_windows(roles)]) + "\n"


def _column(role: str, at: int, look: Look) -> list[str]:
    name = _quoted(look.names[at]) if at < len(look.names) and look.names[at] else str(at + 1)
    unit = look.units[at] if at < len(look.units) else ""
    lines = ["", f"[columns.{role}]", f"name = {name}"]
    if not unit:
        return [*lines, 'unit = "N"  # TODO: nothing says it' if "force" in role else 'unit = "V"']
    lines.append(f"unit = {_quoted(unit)}")
    if "force" in role and role not in of_kind(unit) and unit in ("V", "mV"):
        lines += ["gain = 1.0  # TODO: of the sensor", 'gain_unit = "N/V"']
    return lines


def _is_negative(lines: list[str], look: Look, at: int) -> bool:
    """Whether most numbers of a column are."""
    cells = [cells_of(line, look.separator) for line in lines[look.header_line :]]
    said = [row[at].replace(look.decimal, ".") for row in cells if at < len(row)]
    numbers = [float(cell) for cell in said if is_number(cell)]
    return sum(number < 0.0 for number in numbers) > 0.5 * len(numbers)


def _conditions(path: Path) -> list[str]:
    found = in_name(path)
    patterns = ", ".join(f"'{pattern}'" for pattern, _ in found.values())
    units = ", ".join(f"{name} = {_quoted(unit)}" for name, (_, unit) in found.items() if unit)
    return [
        "",
        "[conditions]",
        f"patterns = [{patterns}]",
        f"units = {{ {units} }}",
        'voltage_is = "peak"  # or peak_to_peak, rms',
    ]


def _windows(roles: dict[str, int]) -> list[str]:
    column = next((c for c in ("voltage", "electrode_voltage") if c in roles), None)
    mark = f"column = {_quoted(column)}" if column else "start_s = 1.0  # TODO: when it comes on"
    motion = ["", "[motion]"] if {"position", "speed"} & set(roles) else []
    return [
        *["", "[voltage_on]", mark],
        *motion,
        *["", "[baseline]  # friction before the voltage", "start_s = -0.4", "end_s = -0.05"],
        *["", "[[windows]]", "start_s = 0.3", "end_s = 0.8"],
    ]


def _quoted(text: str) -> str:
    return json.dumps(text, ensure_ascii=False)
