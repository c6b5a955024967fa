"""Units as labs write them -> SI, by pint; what is not understood is refused by name."""

from __future__ import annotations

import re
from collections.abc import Sequence
from functools import cache
from math import isclose, isfinite, sqrt
from typing import Any, NamedTuple

from model.support.errors import ModelError

SI = {
    "time": "s",
    "lateral_force": "N",
    "normal_force": "N",
    "voltage": "V",
    "electrode_voltage": "V",
    "voltage_offset": "V",
    "frequency": "Hz",
    "position": "m",
    "speed": "m/s",
}
BY_ENDING = {  # of a column's name; the longest that fits
    "_m_s": "m/s",
    "_hz": "Hz",
    "_rad": "rad",
    "_m2": "m^2",
    "_mm": "mm",
    "_um": "um",
    "_pct": "percent",
    "_v": "V",
    "_n": "N",
    "_a": "A",
    "_s": "s",
    "_m": "m",
}
WITHOUT_UNIT = ("cof", "cof_std")
TURNS = ("rad", "deg", "rpm", "revolution", "turn", "cycle")  # 1 rad/s is not 1 Hz
AMPLITUDES = ("voltage", "voltage_v", "electrode_voltage_v")  # which Vpp and Vrms may be units of
PEAK_OF_RMS = {"sine": sqrt(2.0), "square": 1.0, "dc": 1.0}
PP, RMS = "volt_peak_to_peak", "volt_rms"
DEFINED = (f"{PP} = 0.5 * volt = Vpp", f"{RMS} = {sqrt(2.0)!r} * volt = Vrms")
SPELLED = {  # ways to write how a voltage counts, and small letters that are sure
    r"^(k?)hz$": r"\1Hz",
    r"^kv$": "kV",
    r"^([km]?)v(?=[ _-]?(?:pp|pk|peak|rms))": r"\1V",
    r"(?<=V)[ _-]?p(?:ea)?k?[ _-]?(?:to)?[ _-]?p(?:ea)?k?$": "pp",
    r"(?<=V)[ _-]?ss$": "pp",  # German, from peak to peak
    r"(?<=V)[ _-]?(?:rms|eff)$": "rms",
    r"(?<=V)[ _-]?(?:peak|pk|p)$": "",
}
ROUNDED = 1e-3  # relative: a number that was converted and written with few digits
LONGEST = 40  # letters of a unit
UNREASONABLE = re.compile(r"(\*\*|\^)\s*-?\d{2}|(\*\*|\^).*(\*\*|\^)|\d{10}")
BRACKETED = re.compile(
    r"(.+?)\s*(?:\[(.+)\]|\((.+)\)|(?:[,/]|\bin)\s+(.+)|/([^/\s]+(?:/[^/\s]+)?))"
)


class NameSaid(NamedTuple):
    """A column's name without its unit, and that unit as written, empty where it has none."""

    bare: str
    unit: str


@cache
def _registry() -> Any:
    import pint  # noqa: PLC0415  (slow to import)

    registry: Any = pint.UnitRegistry()
    for line in DEFINED:
        registry.define(line)
    return registry


@cache
def understood(text: str) -> Any:
    """The quantity that one of a unit is, None where a text is no unit; with a factor, as 0.5 V.

    Vpp and Vrms are the amplitudes of a sine. Capitals as in Newton are let pass.
    """
    import pint  # noqa: PLC0415

    said = text.strip()
    if not said or len(said) > LONGEST or UNREASONABLE.search(said):
        return None
    for pattern, written in SPELLED.items():
        said = re.sub(pattern, written, said, flags=re.IGNORECASE)
    for spelled in (said, said.lower() if len(said) > 3 else said):
        try:
            found = _registry().parse_expression(spelled)
        except (pint.UndefinedUnitError, ValueError, AssertionError, TypeError, AttributeError):
            continue
        except Exception as error:  # pint lets what its parser meets through
            if type(error).__module__.partition(".")[0] not in ("pint", "tokenize", "builtins"):
                raise
            continue
        if isinstance(found, _registry().Quantity) and isfinite(found.magnitude):
            return found
    return None


def of_kind(text: str) -> list[str]:
    """The quantities of `SI` that a unit may be of."""
    unit = understood(text)
    return [] if unit is None else [name for name in SI if _fits(unit, SI[name], name)]


def is_rms(text: str) -> bool:
    """Whether a unit counts a voltage by its root mean square."""
    unit = understood(text)
    return unit is not None and RMS in str(unit.units)


def to_si(quantity: str, unit: str, where: str, gain_unit: str = "") -> float:
    """The factor from `unit`, times `gain_unit`, to SI; ModelError names a unit at fault."""
    return _factor(unit, SI[quantity], quantity, where, gain_unit)


def to_column(column: str, unit: str, where: str) -> float:
    """The factor from `unit` to that in the name of a column; ModelError where it has none."""
    ours = unit_of(column)
    if ours is None:
        said = f"{where}: no unit is converted for {column}"
        raise ModelError(said, "Leave the unit out", "unknown_unit")
    return _factor(unit, ours, "frequency" if ours == "Hz" else column, where)


def unit_of(column: str) -> str | None:
    """The unit in the name of one of our columns; 1 for a pure number."""
    endings = (ours for ending, ours in BY_ENDING.items() if column.endswith(ending))
    return "1" if column in WITHOUT_UNIT else next(endings, None)


def stem_of(column: str) -> str:
    """The name of one of our columns without its unit."""
    ending = next((each for each in BY_ENDING if column.endswith(each)), "")
    return column.removesuffix(ending)


class Near(NamedTuple):
    """A column that is one of ours by another name; its unit is empty where its name has none."""

    column: str
    unit: str


def near(columns: Sequence[str], known: Sequence[str]) -> dict[str, Near]:
    """Columns of a file that are ours in another unit or other capitals, or without a unit."""
    found: dict[str, Near] = {}
    there = set(columns)
    strange = [column for column in columns if column not in known]
    for ours in known:
        if ours in there:
            continue
        others = by_other_names(strange, ours)
        if others:
            found[ours] = others[0]
    return found


def by_other_names(columns: Sequence[str], ours: str) -> list[Near]:
    """The columns that are one of ours by another name."""
    unit, stem = unit_of(ours), stem_of(ours).casefold()
    if unit is None:
        return []
    return [
        Near(column, said)
        for column in columns
        if column != ours and column.casefold().startswith(stem)
        if (said := _said_unit(column, ours, unit)) is not None
    ]


def unit_in_name(column: str, ours: str) -> str:
    """The unit that a column's name says of itself, where it stands for one of ours."""
    unit = unit_of(ours)
    if unit is None or column == ours:
        return ""
    return named_unit(column).unit or suffix_unit(column, unit, ours).unit


def contradicts(said: str, own: str) -> bool:
    """Whether a unit that a person says cannot be that of a name; a factor before it is a gain."""
    first, second = understood(said), understood(own)
    if first is None or second is None or same(said, own):
        return False
    if first.magnitude == 1.0:
        return True
    return first.is_compatible_with(second) and not same(str(first.units), own)


def differ(one: str | float, other: str | float) -> bool:
    """Whether two numbers of one quantity are more than rounding apart; texts that are none are
    not.
    """
    try:
        return not isclose(float(one), float(other), rel_tol=ROUNDED) and one != other
    except ValueError:
        return False


def _said_unit(column: str, ours: str, unit: str) -> str | None:
    """The unit of a column that is ours by its name, empty where it has none; None where it is
    another column.
    """
    if column.casefold() == ours.casefold():
        return unit
    names = (ours.casefold(), stem_of(ours).casefold())
    for said in (named_unit(column), suffix_unit(column, unit, ours)):
        if said.unit and said.bare.casefold() in names:
            return said.unit
    return "" if column.casefold() == names[1] else None


def named_unit(name: str) -> NameSaid:
    """A name and the unit behind it: Fx [mN], Fx (mN), "Fx, mN", Fx / mN.

    What stands there and is no unit belongs to the name.
    """
    match = BRACKETED.fullmatch(name.strip())
    unit = next((found for found in match.groups()[1:] if found), "") if match else ""
    is_unit = of_kind(unit) if match and match[5] else understood(unit) is not None
    if match is None or not is_unit:
        return NameSaid(name.strip(), "")
    return NameSaid(match[1].strip(), unit.strip())


def suffix_unit(name: str, ours: str, quantity: str = "") -> NameSaid:
    """A name and the unit at its end behind _ or a blank, of the kind of `ours`: time_ms, v_mm_s.

    A sensor's V counts for every kind.
    """
    parts = re.split(r"[_ ]", name.strip())
    for count in (2, 1):
        if len(parts) <= count:
            continue
        text = "/".join(parts[-count:])
        unit = understood(text)
        if unit is not None and (_fits(unit, ours, quantity) or text in ("V", "mV")):
            return NameSaid("_".join(parts[:-count]), text)
    return NameSaid(name.strip(), "")


def same(one: str, other: str) -> bool:
    """Whether two texts are one unit; a force is often written as a mass: g for gf."""
    first, second = understood(one), understood(other)
    if first is None or second is None:
        return one == other
    if not first.is_compatible_with(second):
        return f"{one}f" == other or f"{other}f" == one
    return bool(abs((first / second).to("").magnitude - 1.0) < 1e-9)


def _factor(unit: str, ours: str, quantity: str, where: str, gain_unit: str = "") -> float:
    whole = _registry().Quantity(1.0, "")
    for text in filter(None, (unit, gain_unit)):
        found = understood(text)
        if found is None:
            said = f"{where}: '{text}' is no unit that is understood"
            more = "; voltage_v is peak: Vpp, Vrms and factors as 100 V too"
            hint = f"Write one of {quantity}, such as {ours}"
            hint += more if quantity in AMPLITUDES else ""
            raise ModelError(said, hint, "unknown_unit")
        whole = whole * found
    if not _fits(whole, ours, quantity):
        said = f"{where}: {' times '.join(filter(None, (unit, gain_unit)))} is no {quantity}"
        hint = f"Write a unit of {ours}; a sensor's volts need gain and gain_unit, such as {ours}/V"
        more = "; a force in grams is gf" if str(whole.units) in ("gram", "kilogram") else ""
        raise ModelError(said, hint + more, "unknown_unit")
    return float(whole.to(ours).magnitude)


def _fits(whole: Any, ours: str, quantity: str) -> bool:
    """Whether a quantity is of the unit `ours`, and not one that only looks so."""
    words = str(whole.units)
    if quantity == "frequency" and any(word in words for word in TURNS):
        return False
    if quantity not in AMPLITUDES and (PP in words or RMS in words):
        return False
    return bool(whole.is_compatible_with(ours))
