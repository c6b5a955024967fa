"""What others make of the same sets: the least AICc and BIC of single effects, and a classifier.

Each of them names one effect or none. None of them can say that something is unknown or that two
are there, which the rows about strangers and pairs show.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

from .scores import CLEAR, NONE, Answer, Guess, hidden, wilson

SURE = 0.95  # as the diagnosis must be of a name
Named = Callable[[str, Answer], set[str] | None]  # None where a method was not asked
Part = list[tuple[dict[str, Any], set[str]]]


def peers_table(
    answers: dict[str, Answer], labels: dict[str, Any], guesses: dict[str, Guess], notes: list[str]
) -> str:
    """Markdown: one table for every kind of witnesses, a column for every method."""
    lines = ["", "## The same sets by others", ""]
    lines += ["A name counts as wrong where what it names is not hidden."]
    lines += ["Boosted trees were trained on sets that the project's own model simulates:", ""]
    lines += [f"- {note}" for note in notes]
    for kind in sorted({_kind(labels[name]) for name in answers}):
        mine = {name: got for name, got in answers.items() if _kind(labels[name]) == kind}
        lines += ["", f"### {kind}", "", *_table(mine, labels, guesses)]
    return "\n".join(lines) + "\n"


def _kind(label: dict[str, Any]) -> str:
    known = {"all": "All witnesses", "friction": "Friction alone"}
    return known.get(label.get("witnesses", ""), "Friction, over several designs")


def _methods(guesses: dict[str, Guess]) -> dict[str, Named]:
    def one(name: str) -> set[str]:
        return {name} - {NONE}

    def guess(file: str, least: float) -> set[str] | None:
        if file not in guesses:
            return None
        return one(guesses[file].name) if guesses[file].probability >= least else set()

    return {
        "diagnosis": lambda _, got: set(got.names) if got.verdict == "effect_found" else set(),
        "AICc": lambda _, got: one(got.aicc),
        "BIC": lambda _, got: one(got.bic),
        "boosted trees": lambda file, _: guess(file, 0.0),
        f"boosted trees, {100 * SURE:.0f} % sure": lambda file, _: guess(file, SURE),
    }


def _table(
    answers: dict[str, Answer], labels: dict[str, Any], guesses: dict[str, Guess]
) -> Iterator[str]:
    methods = _methods(guesses)
    columns = []
    for named in methods.values():
        asked = [(labels[file], named(file, got)) for file, got in answers.items()]
        columns.append(_rates([(label, names) for label, names in asked if names is not None]))
    yield "| | " + " | ".join(methods) + " |"
    yield "|---" * (len(methods) + 1) + "|"
    for row, *cells in zip(ROWS, *columns, strict=True):
        yield f"| {row} | {' | '.join(cells)} |"


ROWS = (
    "sets answered",
    f"visible single effects (lambda >= {CLEAR:g}) named rightly",
    "wrong name, of all sets",
    "nothing hidden, a name",
    f"visible strangers (lambda >= {CLEAR:g}) given a name",
    f"two visible effects (lambda >= {CLEAR:g}) both named",
    "the same, one named and none wrongly",
)


def _rates(part: Part) -> list[str]:
    clear = [one for one in part if all(e["lambda"] >= CLEAR for e in one[0]["effects"])]
    strange = [one for one in clear if any(e["stranger"] for e in one[0]["effects"])]
    known = [one for one in clear if one not in strange]
    null, single, double = ([one for one in known if len(hidden(one[0])) == n] for n in (0, 1, 2))
    right = [names for label, names in double if names and names <= hidden(label)]
    return [
        str(len(part)),
        wilson(sum(names == hidden(label) for label, names in single), len(single)),
        wilson(sum(bool(names - hidden(label)) for label, names in part), len(part)),
        wilson(sum(bool(names) for _, names in null), len(null)),
        wilson(sum(bool(names) for _, names in strange), len(strange)),
        wilson(sum(len(names) == 2 for names in right), len(double)),
        wilson(sum(len(names) == 1 for names in right), len(double)),
    ]
