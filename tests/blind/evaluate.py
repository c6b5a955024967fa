"""Score the diagnosis workflow, and others beside it, on sets whose labels it never sees.

`python -m tests.blind.evaluate --sets DIR --out FILE.md` diagnoses DIR/sets/*.csv, opens
DIR/labels.json only afterwards, and writes tables with Wilson intervals: by what was measured,
and beside AICc, BIC and a classifier. Of twins it prints how many are named so far after each pair.
"""

from __future__ import annotations

import argparse
import hashlib
import json
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
from .scores import Answer, Guess
from .sets_csv import write_csv
from .witness_table import witness_table

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
    return Answer(
        verdict.verdict,
        names,
        group,
        top,
        probability,
        _least(hypotheses, aicc, found.data.count),
        _least(hypotheses, bic, found.data.count),
        adequate=verdict.adequate,
    )


def _least(found: Any, charge: Callable[[int, int], float], n: int) -> str:
    """The least criterion among none and the single effects, as people choose by hand."""
    models = [found.base, *found.singles]
    return str(min(models, key=lambda c: c.fit.chi2 + charge(c.fit.vector.size, n)).name)


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
    text = witness_table(judged, labels) + peers_table(judged, labels, guesses, notes)
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
