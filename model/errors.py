"""What can be wrong with the input of the model, in terms a user can act on."""

from __future__ import annotations

from difflib import get_close_matches


class ModelError(ValueError):
    """Bad input to the model: `message` says what and where, `hint` what to do, `code` names the kind of mistake."""

    def __init__(self, message: str, hint: str = "", code: str = "bad_model") -> None:
        super().__init__(f"{message}. {hint}" if hint else message)
        self.message = message
        self.hint = hint
        self.code = code


def nearest(word: str, choices: list[str]) -> str:
    """A hint that offers the choice nearest to `word`, and all of them."""
    close = get_close_matches(word, choices, n=1, cutoff=0.5)
    listed = ", ".join(sorted(choices))
    return f"Did you mean '{close[0]}'? Known: {listed}" if close else f"Known: {listed}"
