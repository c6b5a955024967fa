"""What can be wrong with the input of the model, in terms a user can act on."""

from __future__ import annotations

from difflib import get_close_matches

from haptic_driver.base.errors import BadInputError


class ModelError(BadInputError, ValueError):
    """Bad input to the model; a ValueError too, as Python's own libraries raise for it."""

    def __init__(self, message: str, hint: str = "", code: str = "bad_model") -> None:
        super().__init__(code, message, hint)


class RowError(ModelError):
    """What is wrong in one row, from 0, of conditions; `said` does not name the row, for who knows
    its line.
    """

    def __init__(self, row: int, said: str, hint: str = "") -> None:
        super().__init__(f"row {row + 1}: {said}", hint)
        self.row = row
        self.said = said


def nearest(word: str, choices: list[str]) -> str:
    """A hint that offers the choice nearest to `word`, and all of them."""
    return f"{did_you_mean(word, choices)}Known: {', '.join(sorted(choices))}"


def did_you_mean(word: str, choices: list[str]) -> str:
    """The question that opens a hint, with a space after it; nothing where no choice is like
    `word`.
    """
    close = [choice for choice in choices if choice.casefold() == word.casefold()]
    close = close or [choice for choice in choices if choice.startswith(f"{word}_")]
    close = close or get_close_matches(word, choices, n=1, cutoff=0.5)
    return f"Did you mean '{close[0]}'? " if close else ""
