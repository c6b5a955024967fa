"""What can go wrong, in terms a user can act on."""

from __future__ import annotations

import importlib
from typing import Any


class HapticError(Exception):
    """A failure with a stable code, a message (what, where) and a hint (what to do).

    Exit status 1; subclasses for bad input exit with 2.
    """

    exit_status = 1

    def __init__(self, code: str, message: str, hint: str = "") -> None:
        message, hint = (
            shown(message),
            shown(hint, lines=True),
        )  # they name what a user or a stranger has named
        super().__init__(message)
        self.code = code
        self.message = message
        self.hint = hint
        if hint:
            self.add_note(f"hint: {hint}")  # what a traceback shows below the message

    @property
    def content(self) -> dict[str, str]:
        """What `--json` and the API say of it."""
        return {"code": self.code, "message": self.message, "hint": self.hint}


class BadInputError(HapticError):
    """The user's input cannot be used as given."""

    exit_status = 2


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


def message_of(error: BaseException) -> str:
    """What an error says, of whatever kind it is; one that is none of ours with the name of its
    kind.
    """
    said = getattr(error, "message", None)
    return shown(said if isinstance(said, str) else f"{type(error).__name__}: {error}")


def shown(text: str, *, lines: bool = False) -> str:
    """Text with every character that does not print as Python would write it, such as \\x1b;
    `lines` keeps its lines.

    Escape sequences, newlines and marks that turn the direction of writing would otherwise say
    something else than what stands there.
    """
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() or (lines and c == "\n") else _escaped(c) for c in text)


def _escaped(character: str) -> str:
    return character.encode("unicode_escape").decode("ascii")
