"""What can go wrong, and what the driver asks of values and packages."""

from __future__ import annotations

import importlib
from typing import Any

from haptic_driver.base.errors import BadInputError, HapticError, message_of, shown

__all__ = ["BadInputError", "HapticError", "message_of", "optional", "require_range", "shown"]


def require_range(what: str, value: float, low: float, high: float, *, unit: str = "") -> None:
    """BadInputError for a value that is not within `low` to `high`; `unit` with its blank."""
    if not low <= value <= high:
        said = f"{what} {value:g}{unit} is out of range"
        raise BadInputError("out_of_range", said, f"Give {low:g} to {high:g}{unit}")


def optional(module: str, extra: str, what: str) -> Any:
    """A module of a package that only `haptic-driver[extra]` brings; HapticError where it is not
    there for `what`.
    """
    try:
        return importlib.import_module(module)
    except (
        ImportError,
        RuntimeError,
    ) as error:  # pylsl raises RuntimeError where its library is missing
        said = f"{what} needs a package that is not there ({error})"
        raise HapticError(
            "missing_package", said, f"Install it: pip install 'haptic-driver[{extra}]'"
        ) from error
