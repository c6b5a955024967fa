"""Every set in one row: what was hidden, what the diagnosis said, what others said."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

from .scores import Answer, Guess

COLUMNS = (
    "set",
    "witnesses",
    "hidden",
    "form",
    "lambda",
    "verdict",
    "named",
    "or",
    "probability",
    "adequate",
    "aicc",
    "bic",
    "boosted_trees",
    "boosted_trees_probability",
)


def write_csv(
    path: Path, answers: dict[str, Answer], labels: dict[str, Any], guesses: dict[str, Guess]
) -> None:
    """Write the rows in the order of the sets; names are joined by spaces."""
    with path.open("w", newline="", encoding="utf-8") as file:
        rows = csv.DictWriter(file, COLUMNS, restval="", lineterminator="\n")
        rows.writeheader()
        for name in sorted(answers):
            rows.writerow(_row(name, answers[name], labels[name], guesses.get(name)))


def _row(name: str, got: Answer, label: dict[str, Any], guess: Guess | None) -> dict[str, object]:
    effects = label["effects"]
    row: dict[str, object] = {
        "set": name,
        "witnesses": label.get("witnesses", "friction"),
        "hidden": " ".join(effect["name"] for effect in effects),
        "form": " ".join(str(effect["form"]) for effect in effects),
        "lambda": " ".join(f"{effect['lambda']:.1f}" for effect in effects),
        "verdict": got.verdict,
        "named": " ".join(got.names),
        "or": " ".join(got.group),
        "probability": f"{got.probability:.4f}",
        "adequate": str(got.adequate).lower(),
        "aicc": got.aicc,
        "bic": got.bic,
    }
    if guess is not None:
        row |= {
            "boosted_trees": guess.name,
            "boosted_trees_probability": f"{guess.probability:.4f}",
        }
    return row
