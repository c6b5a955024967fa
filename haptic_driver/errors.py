"""What can go wrong, in terms a user can act on."""

from __future__ import annotations


class HapticError(Exception):
    """A failure with a stable code, a message (what, where) and a hint (what to do).

    Exit status 1; subclasses for bad input exit with 2.
    """

    exit_status = 1

    def __init__(self, code: str, message: str, hint: str = "") -> None:
        super().__init__(message)
        self.code = code
        self.message = message
        self.hint = hint


class BadInputError(HapticError):
    """The user's input cannot be used as given."""

    exit_status = 2
