"""Score the diagnosis workflow, and others beside it, on sets whose labels it never sees.

`python -m tests.blind.evaluate --sets DIR --out FILE.md` diagnoses DIR/sets/*.csv, opens
DIR/labels.json only afterwards, and writes tables with Wilson intervals: by visibility, and beside
AICc, BIC and a classifier. Of twins it prints how many are named so far after each pair.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import math
import os
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from haptic_driver.lab.challenge.own import aicc, bic

from .pairs import pairs_of, pairs_table, so_far
from .peers import peers_table
from .scores import Answer, Guess, bins, calibration_error, chance_error, reliability, wilson
from .sets_csv import write_csv
from .witness_table import witness_table

VISIBLE = ((0, 12), (12, 35), (35, 75), (75, 200), (200, math.inf))
MODEL = Path(__file__).resolve().parents[2] / "configs" / "models" / "reference.toml"


def answer(path: str) -> Answer:
    from model.description import read_model
    from model.diagnosis.data import read_measurements
    from model.diagnosis.workflow import diagnose

    try:
        found = diagnose(read_model(MODEL), read_measurements(Path(path)))
    except Exception as error:
        return Answer("error", (), (), "none", 0.0, "none", "none", repr(error))
    if found.findings is None:
        return Answer("not_testable", (), (), "none", 0.5, "none", "none")
    verdict, hypotheses = found.findings.verdict, found.findings.hypotheses
    names = verdict.decision.names
    group = tuple(name for members in verdict.group.values() for name in members)
    top, probability = next(iter(verdict.posterior.inclusion.items()))
    baselines = (
        _least(hypotheses, aicc, found.data.count),
        _chi2(hypotheses),
    )
    bic_name = _least(hypotheses, bic, found.data.count)
    return Answer(
        verdict.verdict,
        names,
        group,
        top,
        probability,
        *baselines,
        adequate=verdict.adequate,
        bic=bic_name,
    )


def _least(found: Any, charge: Callable[[int, int], float], n: int) -> str:
    """The least criterion among none and the single effects, as people choose by hand."""
    models = [found.base, *found.singles]
    return str(min(models, key=lambda c: c.fit.chi2 + charge(c.fit.vector.size, n)).name)


def _chi2(found: Any) -> str:
    """The effect with the least chi-square, whatever it is worth."""
    return str(min(found.singles, key=lambda c: c.fit.chi2).name)


def cannot_be_found(label: dict[str, Any], columns: tuple[str, ...]) -> bool:
    """Whether one hidden effect leaves no trace in the file's columns, or nothing there says how
    noisy it is.

    Judged by the label and the file's header alone: what the workflow answers has no part in it.
    """
    from model.effects import BY_NAME

    noise = {"cof_std", "trial"} & set(columns)
    return not noise or not set(BY_NAME[label["effects"][0]["name"]].needs) <= set(columns)


def table(
    answers: dict[str, Answer], labels: dict[str, Any], columns: dict[str, tuple[str, ...]]
) -> str:
    """Everything as Markdown; `columns` are the headers of the files."""
    rows = [(labels[name], got) for name, got in answers.items()]
    null = [got for label, got in rows if not label["effects"]]
    strange = [(label, got) for label, got in rows if any(e["stranger"] for e in label["effects"])]
    one = {
        n
        for n in answers
        if len(labels[n]["effects"]) == 1 and not labels[n]["effects"][0]["stranger"]
    }
    hopeless = {n for n in one if cannot_be_found(labels[n], columns[n])}
    single = [(labels[n], answers[n]) for n in sorted(one - hopeless)]
    double = [(label, got) for label, got in rows if len(label["effects"]) > 1]
    lines = [
        f"{len(rows)} sets; every rate in percent with its 95 % Wilson interval and counts.",
        "",
        "## Nothing hidden",
        "",
    ]
    lines += ["| | rate |", "|---|---|"]
    lines.append(
        "| a name is given (`effect_found`) |"
        f" {wilson(sum(g.verdict == 'effect_found' for g in null), len(null))} |"
    )
    lines.append(
        "| candidates are listed (`ambiguous`) |"
        f" {wilson(sum(g.verdict == 'ambiguous' for g in null), len(null))} |"
    )
    lines.append(
        f"| AICc names something | {wilson(sum(g.aicc != 'none' for g in null), len(null))} |"
    )
    lines.append(
        f"| BIC names something | {wilson(sum(g.bic != 'none' for g in null), len(null))} |"
    )
    lines += ["", "## One effect hidden, by visibility", ""]
    lines += [
        (
            "| lambda | right effect or its group | named rightly | named wrongly | AICc right |"
            " BIC right | chi-square right |"
        ),
        "|---|---|---|---|---|---|---|",
    ]
    for low, high in VISIBLE:
        part = [
            (l_["effects"][0]["name"], g)
            for l_, g in single
            if low <= l_["effects"][0]["lambda"] < high
        ]
        n = len(part)
        right = sum(t in (*g.names, *g.group) for t, g in part)
        named = sum(g.verdict == "effect_found" and t in g.names for t, g in part)
        wrong = sum(g.verdict == "effect_found" and t not in g.names for t, g in part)
        lines.append(
            f"| {low}..{high} | {wilson(right, n)} | {wilson(named, n)} | {wilson(wrong, n)} |"
            f" {wilson(sum(g.aicc == t for t, g in part), n)} |"
            f" {wilson(sum(g.bic == t for t, g in part), n)} |"
            f" {wilson(sum(g.chi2 == t for t, g in part), n)} |"
        )
    lines += [
        "",
        (
            f"Not counted above: {_sets(len(hopeless))} whose columns hold no trace of the hidden"
            " effect or no noise."
        ),
    ]
    lines.append(_verdicts("They are called", [answers[n] for n in sorted(hopeless)]))
    lines += ["", "## Outside the catalogue, by what the catalogue leaves unexplained", ""]
    lines += [
        "| lambda_left | `unexplained` | named (`effect_found`) | AICc names something |",
        "|---|---|---|---|",
    ]
    for low, high in ((0, 25), (25, 100), (100, math.inf)):
        part2 = [g for l_, g in strange if low <= l_.get("lambda_left", 0.0) < high]
        n = len(part2)
        lines.append(
            f"| {low}..{high} | {wilson(sum(g.verdict == 'unexplained' for g in part2), n)} | "
            f"{wilson(sum(g.verdict == 'effect_found' for g in part2), n)} | "
            f"{wilson(sum(g.aicc != 'none' for g in part2), n)} |"
        )
    if double:
        both = sum({e["name"] for e in l_["effects"]} <= {*g.names, *g.group} for l_, g in double)
        some = sum(
            any(e["name"] in (*g.names, *g.group) for e in l_["effects"]) for l_, g in double
        )
        wrong = sum(
            g.verdict == "effect_found" and not {e["name"] for e in l_["effects"]} & set(g.names)
            for l_, g in double
        )
        lines += ["", "## Two effects hidden", "", "| | rate |", "|---|---|"]
        lines.append(f"| both found | {wilson(both, len(double))} |")
        lines.append(f"| at least one found | {wilson(some, len(double))} |")
        lines.append(f"| only wrong names | {wilson(wrong, len(double))} |")
    lines += ["", "## By family", "", "| family | sets | verdicts |", "|---|---|---|"]
    for family in sorted({l_["family"] for l_, _ in rows}):
        part = [g for l_, g in rows if l_["family"] == family]
        lines.append(f"| {family} | {len(part)} | {_verdicts('', part)} |")
    lines += _calibration_lines(reliability(answers, labels))
    misnamed = [
        f"- {name}: hidden {[e['name'] for e in labels[name]['effects']] or 'nothing'}, named"
        f" {list(got.names)}"
        for name, got in answers.items()
        if got.verdict == "effect_found"
        and not {e["name"] for e in labels[name]["effects"]} & set(got.names)
    ]
    lines += ["## Every wrong name", "", *(misnamed or ["none"]), ""]
    errors = [f"- {name}: {got.error}" for name, got in answers.items() if got.error]
    return "\n".join(lines + (["## Errors", "", *errors, ""] if errors else []))


def _sets(count: int) -> str:
    return "1 set" if count == 1 else f"{count} sets"


def _verdicts(before: str, part: list[Answer]) -> str:
    got = [g.verdict for g in part]
    return f"{before} {', '.join(f'{v} {got.count(v)}' for v in sorted(set(got))) or '-'}".strip()


def _calibration_lines(pairs: list[tuple[float, float]]) -> list[str]:
    mean, limit = chance_error(pairs)
    lines = [
        "",
        "## Probability of the most probable answer",
        "",
        "| stated | sets | mean stated | right |",
        "|---|---|---|---|",
    ]
    for i, part in bins(pairs).items():
        stated, hits = (sum(column) for column in zip(*part, strict=True))
        right = wilson(int(hits), len(part))
        lines.append(
            f"| {i / 10:.1f}..{(i + 1) / 10:.1f} | {len(part)} | {stated / len(part):.2f} |"
            f" {right} |"
        )
    lines += [
        "",
        (
            f"Expected calibration error: {calibration_error(pairs):.3f}; perfectly calibrated"
            " answers to as many sets"
        ),
    ]
    lines += [
        f"would show {mean:.3f} on average and {limit:.3f} in one case of twenty, by chance alone.",
        "",
    ]
    return lines


def run(
    sets: Path, workers: int, told: Callable[[dict[str, Answer]], None] = lambda _: None
) -> dict[str, Answer]:
    """Diagnose every set, which sees no label; `told` hears all answers after each.

    An answer is kept in DIR/answers.json by the content of its file, which is not asked again.
    """
    files = sorted((sets / "sets").glob("*.csv"))
    content = {file.name: hashlib.sha256(file.read_bytes()).hexdigest() for file in files}
    kept = sets / "answers.json"
    known = json.loads(kept.read_text()) if kept.exists() else {}
    answers = {n: _kept(known[content[n]]) for n in content if content[n] in known}
    left = [file for file in files if file.name not in answers]
    if answers:
        print(f"{len(answers)} of {len(files)} sets were answered before: {kept}", flush=True)
    os.environ["OPENBLAS_NUM_THREADS"] = (
        "1"  # read when numpy is imported, hence in fresh processes
    )
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
        for file, got in zip(left, pool.map(answer, map(str, left)), strict=True):
            answers[file.name] = got
            known[content[file.name]] = got._asdict()
            kept.write_text(json.dumps(known, indent=1))
            told(answers)
    return {file.name: answers[file.name] for file in files}


def _kept(said: dict[str, Any]) -> Answer:
    return Answer(**said | {name: tuple(said[name]) for name in ("names", "group")})


def guesses_of(sets: Path) -> tuple[dict[str, Guess], list[str]]:
    """What a classifier says of the sets, labels closed, and notes on it; kept in
    DIR/classifier.json.
    """
    kept = sets / "classifier.json"
    if kept.exists():
        said, notes = json.loads(kept.read_text())
        return {name: Guess(*guess) for name, guess in said.items()}, notes
    from model.description import read_model

    from .classifier import classified

    try:
        guesses, notes = classified(read_model(MODEL), sorted((sets / "sets").glob("*.csv")))
    except ImportError:
        return {}, ["not asked: scikit-learn is not installed"]
    kept.write_text(json.dumps([guesses, notes], indent=1))
    return guesses, notes


def _header(path: Path) -> tuple[str, ...]:
    with path.open() as lines:
        return tuple(next(lines).strip().split(","))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sets", type=Path, required=True)
    parser.add_argument("--out", type=Path)
    parser.add_argument("--csv", type=Path, help="every set in one row")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument(
        "--pairs", action="store_true", help="sets are twins: compare them, now and at the end"
    )
    given = parser.parse_args()
    path = given.sets / "labels.json"
    if given.pairs:
        answers = run(given.sets, given.workers, partial(_so_far, json.loads(path.read_text())))
        guesses, notes = {}, ["not asked about twins"]
    else:
        answers = run(given.sets, given.workers)
        guesses, notes = guesses_of(given.sets)
    labels = json.loads(path.read_text())
    pairs = pairs_of(answers, labels)
    judged = {pair.measured: answers[pair.measured] for pair in pairs} or answers
    headers = {name: _header(given.sets / "sets" / name) for name in judged}
    witnessed = {name: got for name, got in judged.items() if "witnesses" in labels[name]}
    friction = {name: got for name, got in judged.items() if name not in witnessed}
    text = table(friction, labels, headers) if friction else ""
    text += witness_table(witnessed, labels) if witnessed else ""
    text += peers_table(judged, labels, guesses, notes)
    text += pairs_table(pairs) if pairs else ""
    if given.csv:
        write_csv(given.csv, answers, labels, guesses)
    if given.out:
        given.out.write_text("# Diagnosis on blind data, as measured\n\n" + text)
    print(text)


def _so_far(labels: dict[str, Any], answers: dict[str, Answer]) -> None:
    pairs = pairs_of(answers, labels)
    if pairs and 2 * len(pairs) == len(answers):
        print(so_far(pairs, len(labels) // 2), flush=True)


if __name__ == "__main__":
    main()
