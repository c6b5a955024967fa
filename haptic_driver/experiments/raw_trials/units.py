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
    si = SI[quantity]
    whole = _registry().Unit("")
    for text in filter(None, (unit, gain_unit)):
        found = understood(text)
        if found is None:
            said = f"{where}: '{text}' is no unit that is understood"
            raise BadInputError("unknown_unit", said, f"Write one of {quantity}, such as {si}")
        whole = whole * found
    if not whole.is_compatible_with(si) or not _counts(whole, quantity):
        said = f"{where}: {' times '.join(filter(None, (unit, gain_unit)))} is no {quantity}"
        hint = f"Write a unit of {si}; a sensor's volts need gain and gain_unit, such as {si}/V"
        more = "; a force in grams is gf" if str(whole) in ("gram", "kilogram") else ""
        raise BadInputError("unknown_unit", said, hint + more)
    return float(_registry().Quantity(1.0, whole).to(si).magnitude)


def _counts(unit: Any, quantity: str) -> bool:
    return quantity != "frequency" or not any(word in str(unit) for word in TURNS)
