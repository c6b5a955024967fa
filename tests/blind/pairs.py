"""Sets with measured loads beside their twins with commanded ones: what becomes of the same finger.

Twins share finger, plan, effect and lambda. So what is compared is counted on the same truths.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable
from statistics import median
from typing import Any, NamedTuple

from .scores import NONE, Answer, hidden, wilson


class Judged(NamedTuple):
    """A label and what was answered to its set."""

    label: dict[str, Any]
    got: Answer


class Pair(NamedTuple):
    """The file name of a measured set, its answer, and that to its twin."""

    measured: str
    as_measured: Judged
    as_commanded: Judged


def pairs_of(answers: dict[str, Answer], labels: dict[str, Any]) -> list[Pair]:
    """The pairs of which both sets are answered."""
    found = defaultdict[str, dict[bool, str]](dict)
    for name in answers:
        if "pair" in labels[name]:
            found[labels[name]["pair"]]["trials" in labels[name]] = name
    whole = [names for names in found.values() if len(names) == 2]
    return [
        Pair(names[True], *(Judged(labels[names[m]], answers[names[m]]) for m in (True, False)))
        for names in whole
    ]


def is_named(one: Judged) -> bool:
    """Whether all that is hidden is named, and nothing else."""
    return one.got.verdict == "effect_found" and set(one.got.names) == hidden(one.label)


def is_misnamed(one: Judged) -> bool:
    """Whether something is named that is not hidden."""
    return one.got.verdict == "effect_found" and bool(set(one.got.names) - hidden(one.label))


def leads(one: Judged) -> bool:
    """Whether the most probable answer is hidden."""
    return one.got.top in (hidden(one.label) or {NONE})


COUNTED: dict[str, Callable[[Judged], bool]] = {
    "all hidden effects are named": is_named,
    "a wrong name is given": is_misnamed,
    "a hidden effect leads": leads,
}


def _of(pairs: list[Pair], holds: Callable[[Judged], bool]) -> list[tuple[bool, bool]]:
    """Whether it holds, measured and commanded; names of the catalogue are asked for only where
    such an effect is hidden.
    """
    known = [p for p in pairs if _is_known(p.as_measured.label)]
    asked = pairs if holds is is_misnamed else known
    return [(holds(pair.as_measured), holds(pair.as_commanded)) for pair in asked]


def _is_known(label: dict[str, Any]) -> bool:
    return bool(label["effects"]) and not any(e["stranger"] for e in label["effects"])


def so_far(pairs: list[Pair], count: int) -> str:
    """The counts on a line."""
    parts = []
    for said, holds in COUNTED.items():
        found = _of(pairs, holds)
        parts.append(f"{said} {' : '.join(_rates(found))}")
    return f"{len(pairs)} of {count} pairs, measured : commanded; {'; '.join(parts)}"


def _rates(found: list[tuple[bool, bool]]) -> list[str]:
    """How often it holds, measured and commanded."""
    return [wilson(sum(one[side] for one in found), len(found)) for side in (0, 1)]


def pairs_table(pairs: list[Pair]) -> str:
    """Markdown; the last column is 50 % where it makes no difference how loads are told."""
    lines = ["", "## Measured loads beside commanded ones", ""]
    lines += [_lambdas(pairs), ""]
    lines += ["| | measured | commanded | of pairs that differ, measured |", "|---|---|---|---|"]
    for said, holds in COUNTED.items():
        found = _of(pairs, holds)
        measured, commanded = _rates(found)
        differ = [one for one in found if one[0] != one[1]]
        only = wilson(sum(one[0] for one in differ), len(differ))
        lines.append(f"| {said} | {measured} | {commanded} | {only} |")
    return "\n".join(lines) + "\n"


def _lambdas(pairs: list[Pair]) -> str:
    measured = [_lambda(pair.as_measured) for pair in pairs if pair.as_measured.label["effects"]]
    commanded = [_lambda(pair.as_commanded) for pair in pairs if pair.as_commanded.label["effects"]]
    if not measured:
        return f"{len(pairs)} pairs, with nothing hidden."
    return (
        f"{len(pairs)} pairs; median lambda of what is hidden {median(measured):.0f} as measured,"
        f" {median(commanded):.0f} as commanded."
    )


def _lambda(one: Judged) -> float:
    """That of the least visible effect."""
    return float(min(effect["lambda"] for effect in one.label["effects"]))
