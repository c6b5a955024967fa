"""Units as labs write them -> SI, by pint; what is not understood is refused by name."""

from __future__ import annotations

from functools import cache
from typing import Any

from haptic_driver.errors import BadInputError

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


@cache
def _registry() -> Any:
    import pint  # noqa: PLC0415  (slow to import)

    return pint.UnitRegistry()


def understood(text: str) -> Any:
    """The unit that a text is, None where it is none; capitals as in Newton are let pass."""
    import pint  # noqa: PLC0415

    for spelled in (text, text.lower() if len(text) > 3 else text):
        try:
            return _registry().Unit(spelled)
        except (pint.UndefinedUnitError, ValueError, AssertionError, TypeError, AttributeError):
            continue
        except Exception as error:  # pint lets what its parser meets through
            if type(error).__module__.partition(".")[0] not in ("pint", "tokenize", "builtins"):
                raise
    return None


def of_kind(text: str) -> list[str]:
    """The quantities of `SI` that a unit may be of."""
    unit = understood(text) if text.strip() else None
    if unit is None:
        return []
    return [name for name, si in SI.items() if unit.is_compatible_with(si) and _counts(unit, name)]


def to_si(quantity: str, unit: str, where: str, gain_unit: str = "") -> float:
    """The factor from `unit`, times `gain_unit`, to SI; BadInputError names a unit at fault."""
    return _factor(unit, SI[quantity], quantity, where, gain_unit)


def to_column(column: str, unit: str, where: str) -> float:
    """The factor from `unit` to that in the name of a column; BadInputError where it has none."""
    endings = (ours for ending, ours in BY_ENDING.items() if column.endswith(ending))
    ours = "1" if column in WITHOUT_UNIT else next(endings, None)
    if ours is None:
        said = f"{where}: no unit is converted for {column}"
        raise BadInputError("unknown_unit", said, "Leave the unit out")
    return _factor(unit, ours, "frequency" if ours == "Hz" else column, where)


def _factor(unit: str, ours: str, quantity: str, where: str, gain_unit: str = "") -> float:
    whole = _registry().Unit("")
    for text in filter(None, (unit, gain_unit)):
        found = understood(text)
        if found is None:
            said = f"{where}: '{text}' is no unit that is understood"
            raise BadInputError("unknown_unit", said, f"Write one of {quantity}, such as {ours}")
        whole = whole * found
    if not whole.is_compatible_with(ours) or not _counts(whole, quantity):
        said = f"{where}: {' times '.join(filter(None, (unit, gain_unit)))} is no {quantity}"
        hint = f"Write a unit of {ours}; a sensor's volts need gain and gain_unit, such as {ours}/V"
        more = "; a force in grams is gf" if str(whole) in ("gram", "kilogram") else ""
        raise BadInputError("unknown_unit", said, hint + more)
    return float(_registry().Quantity(1.0, whole).to(ours).magnitude)


def _counts(unit: Any, quantity: str) -> bool:
    return quantity != "frequency" or not any(word in str(unit) for word in TURNS)
