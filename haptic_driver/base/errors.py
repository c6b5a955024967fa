"""What can go wrong, in terms a user can act on: one tree for model, devices and driver.

`HapticError` is a failure; its kinds say the cause. `BadInputError`: what was given cannot be used
(`ModelError` of `model`). `DeviceError` of `hw`: a device failed. `RefusedError` of the daemon: not
in its present state. `NoDaemonError` of the client: nobody answers.
"""

from __future__ import annotations


class HapticError(Exception):
    """A failure with a stable code, a message (what, where) and a hint (what to do).

    Exit status 1; bad input exits with 2.
    """

    exit_status = 1

    def __init__(self, code: str, message: str, hint: str = "") -> None:
        # they name what a user or an unknown client has named
        message, hint = shown(message), shown(hint, lines=True)
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


def message_of(error: BaseException) -> str:
    """What an error says, of whatever kind it is; one that is none of ours with the name of its
    kind.
    """
    if isinstance(error, HapticError):
        return error.message
    return shown(f"{type(error).__name__}: {error}")


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
