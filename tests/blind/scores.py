"""What one set got, and how rates are written; shared by the tables."""

from __future__ import annotations

import math
import random
from typing import Any, NamedTuple

NO_TRACE = 2.0  # lambda below which an effect costs more to describe than it explains
CLEAR = 75.0  # lambda from which an effect counts as clearly visible
NONE = "none"  # what a method says that names nothing


class Answer(NamedTuple):
    """What one set got: the workflow's verdict, and the names that two baselines give."""

    verdict: str
    names: tuple[str, ...]
    group: tuple[str, ...]
    top: str
    probability: float
    aicc: str
    bic: str
    error: str = ""
    adequate: bool = True


class Guess(NamedTuple):
    """What a classifier says: the most probable name, or `none`, and its probability."""

    name: str
    probability: float


def hidden(label: dict[str, Any]) -> set[str]:
    """Names of what is hidden."""
    return {effect["name"] for effect in label["effects"]}


def wilson(hits: int, count: int) -> str:
    """A rate with its 95 % Wilson interval, in percent."""
    if not count:
        return "-"
    z, p = 1.96, hits / count
    centre = (p + z * z / (2 * count)) / (1 + z * z / count)
    half = z * math.sqrt(p * (1 - p) / count + z * z / (4 * count * count)) / (1 + z * z / count)
    return (
        f"{100 * p:.0f} ({100 * max(centre - half, 0):.0f}..{100 * min(centre + half, 1):.0f}),"
        f" {hits}/{count}"
    )


def reliability(answers: dict[str, Answer], labels: dict[str, Any]) -> list[tuple[float, float]]:
    """Probability of the most probable answer, and whether it was right (1.0 or 0.0), of every set
    with one truth.

    Strangers are right as `unknown`, what leaves no trace in the columns of the file as `none`.
    """
    pairs = []
    for name, got in answers.items():
        effects = labels[name]["effects"]
        if len(effects) > 1 or got.verdict in ("error", "not_testable"):
            continue
        if not effects or effects[0]["lambda"] < NO_TRACE:
            truth = "none"
        else:
            truth = "unknown" if effects[0]["stranger"] else effects[0]["name"]
        pairs.append((got.probability, float(got.top == truth)))
    return pairs


def calibration_error(pairs: list[tuple[float, float]]) -> float:
    """Expected calibration error, ten bins."""
    return sum(abs(sum(p - hit for p, hit in part)) for part in bins(pairs).values()) / max(
        len(pairs), 1
    )


def chance_error(pairs: list[tuple[float, float]]) -> tuple[float, float]:
    """What chance alone gives so many perfectly calibrated answers: mean and 95 % limit of their
    calibration error.
    """
    chance = random.Random(0)
    errors = sorted(
        calibration_error([(p, float(chance.random() < p)) for p, _ in pairs]) for _ in range(1000)
    )
    return sum(errors) / len(errors), errors[950]


def bins(pairs: list[tuple[float, float]]) -> dict[int, list[tuple[float, float]]]:
    bins: dict[int, list[tuple[float, float]]] = {}
    for p, hit in pairs:
        bins.setdefault(min(int(p * 10), 9), []).append((p, hit))
    return dict(sorted(bins.items()))
