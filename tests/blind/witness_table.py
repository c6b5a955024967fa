"""How well a name is earned with the electrode's witnesses, beside the same friction alone."""

from __future__ import annotations

import statistics
from typing import Any

from .scores import CLEAR, Answer, calibration_error, chance_error, hidden, reliability, wilson

COLUMNS = {"friction": "friction only", "all": "all witnesses"}
Part = list[tuple[dict[str, Any], Answer]]


def _kind(label: dict[str, Any]) -> str:
    return str(label.get("witnesses", "friction"))


def is_wrong(label: dict[str, Any], got: Answer) -> bool:
    """A name of what is not there, or one of two clearly visible effects called adequate."""
    if got.verdict != "effect_found":
        return False
    clear = {effect["name"] for effect in label["effects"] if effect["lambda"] >= CLEAR}
    return bool(set(got.names) - hidden(label)) or (got.adequate and bool(clear - set(got.names)))


def _families(part: Part) -> tuple[Part, Part, Part, Part]:
    """Nothing hidden, one effect, two, strangers."""
    strange = [one for one in part if any(e["stranger"] for e in one[0]["effects"])]
    known = [one for one in part if one not in strange]
    return *([one for one in known if len(one[0]["effects"]) == n] for n in (0, 1, 2)), strange  # type: ignore[return-value]


def _found(part: Part) -> tuple[str, str]:
    """Named rightly; right or in the group."""
    named = sum(
        got.verdict == "effect_found" and set(got.names) == hidden(label) for label, got in part
    )
    listed = sum(hidden(label) <= {*got.names, *got.group} for label, got in part)
    return wilson(named, len(part)), wilson(listed, len(part))


def _size(part: Part) -> str:
    sizes = [len({*got.names, *got.group}) for _, got in part if got.verdict == "ambiguous"]
    return (
        f"{statistics.median(sizes):g} ({max(sizes)} at most), {len(sizes)} sets" if sizes else "-"
    )


def _column(part: Part, answers: dict[str, Answer], labels: dict[str, Any]) -> list[str]:
    null, single, double, strange = _families(part)
    clear = [(label, got) for label, got in single if label["effects"][0]["lambda"] >= CLEAR]
    seen = [got for label, got in strange if label["effects"][0]["lambda"] >= CLEAR]
    pairs = reliability(answers, labels)
    mean, limit = chance_error(pairs)
    return [
        *_found(clear),
        *_found(single),
        wilson(sum(is_wrong(label, got) for label, got in part), len(part)),
        wilson(sum(got.verdict == "effect_found" for _, got in null), len(null)),
        wilson(sum(got.verdict == "ambiguous" for _, got in null), len(null)),
        _size(single),
        *_found(double),
        wilson(sum(got.verdict == "unexplained" for _, got in strange), len(strange)),
        wilson(sum(got.verdict == "unexplained" for got in seen), len(seen)),
        wilson(sum(got.verdict == "effect_found" for _, got in strange), len(strange)),
        f"{calibration_error(pairs):.3f} (by chance {mean:.3f}, {limit:.3f} in one of twenty)",
    ]


ROWS = (
    f"visible single effects (lambda >= {CLEAR:g} in the witnesses used) named rightly",
    "the same, right or in the group",
    "all single effects named rightly",
    "the same, right or in the group",
    "wrong name, of all sets",
    "nothing hidden, a name",
    "nothing hidden, candidates listed",
    "size of the list where no name is given, median",
    "two effects both named",
    "the same, both named or in the groups",
    "strangers `unexplained`",
    f"the same, of visible ones (lambda >= {CLEAR:g} in the witnesses used)",
    "strangers given a name",
    "calibration error of stated probabilities",
)


def witness_table(answers: dict[str, Answer], labels: dict[str, Any]) -> str:
    """Markdown: the rates, then every answer, so that each can be looked into."""
    text = ["| | " + " | ".join(COLUMNS.values()) + " |", "|---|---|---|"]
    columns = []
    for kind in COLUMNS:
        mine = {name: got for name, got in answers.items() if _kind(labels[name]) == kind}
        columns.append(_column([(labels[name], got) for name, got in mine.items()], mine, labels))
    text += [
        f"| {row} | {' | '.join(cells)} |"
        for row, cells in zip(ROWS, zip(*columns, strict=True), strict=True)
    ]
    text += [
        "",
        "| hidden (form, lambda) | witnesses | verdict | named | or | probability |",
        "|---|---|---|---|---|---|",
    ]
    rows = []
    for name, got in answers.items():
        label = labels[name]
        what = (
            ", ".join(f"{e['name']} ({e['form'][:3]}, {e['lambda']:.0f})" for e in label["effects"])
            or "nothing"
        )
        others = " ".join(sorted(set(got.group) - set(got.names)))
        found = (
            got.verdict
            + ("" if got.adequate else ", not adequate")
            + (" **wrong**" if is_wrong(label, got) else "")
        )
        key = (label["family"], label["index"], _kind(label))
        line = (
            f"| {what} | {_kind(label)} | {found} | {' '.join(got.names)} | {others} |"
            f" {got.probability:.2f} |"
        )
        rows.append((key, line))
    return "\n".join(text + [line for _, line in sorted(rows)]) + "\n"
