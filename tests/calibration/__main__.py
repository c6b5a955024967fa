"""`make calibration`: stated probabilities beside how often they were right.

python -m tests.calibration [--sets N] [--seed N] [--out FILE.csv]
"""

from __future__ import annotations

import argparse
import csv
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from itertools import pairwise
from multiprocessing import cpu_count
from pathlib import Path
from typing import NamedTuple

import numpy as np

from haptic_driver.lookup.models import load_model
from model.diagnosis.audit import audited
from model.diagnosis.decide import WITHOUT_NAME, Decision
from model.diagnosis.posterior import Posterior
from model.diagnosis.setting import fitted
from model.diagnosis.workflow import held_out_verdict, weighed
from tests.calibration.draws import Truth, drawn

BINS = (0.0, 0.05, 0.2, 0.5, 0.8, 0.95, 1.0)
MOST_OFF = 0.05  # mean of |stated - right|: more asks for a map from stated to right


class Answer(NamedTuple):
    """Of one set: what is true, what was decided, and every probability with whether it held."""

    number: int
    truth: Truth
    decision: Decision
    stated: list[tuple[float, bool]]


def answer(seed: int, number: int) -> Answer | None:
    """Diagnose one drawn set up to its decision, held-out data included."""
    drew = drawn(seed, number)
    if drew is None:
        return None
    truth, data = drew
    description = load_model("reference")
    audit = audited(description, data)
    if audit.blocked:
        return None
    setting = fitted(description, audit, lambda _: None)
    found = weighed(description, setting, audit, lambda _: None)
    verdict = held_out_verdict(description, setting, found, 0, lambda _: None).verdict
    stated = said(verdict.posterior, verdict.decision, truth)
    return Answer(number, truth, verdict.decision, [stated])


def said(found: Posterior, decision: Decision, truth: Truth) -> tuple[float, bool]:
    """The probability that the verdict states, and whether it is right."""
    if decision.verdict == "effect_found":
        return decision.probability, set(decision.names) <= set(truth.names)
    if decision.verdict == "ambiguous":
        listed = {*decision.names, *(n for alike in decision.group.values() for n in alike)}
        return decision.probability, bool(listed & set(truth.names))
    name = WITHOUT_NAME[decision.verdict == "unexplained"]
    return found.inclusion[name], truth.names == (name,)


def main() -> int:
    """Draw, diagnose, and say how far stated probabilities are off; 1 where by more than 0.05."""
    parser = argparse.ArgumentParser(description="Stated probabilities against what was drawn.")
    parser.add_argument("--sets", type=int, default=200)
    parser.add_argument("--seed", type=int, default=5)
    parser.add_argument("--out", type=Path, default=Path("benchmarks/calibration.csv"))
    asked = parser.parse_args()
    began_s, answers = time.monotonic(), list[Answer]()
    with ProcessPoolExecutor(cpu_count()) as pool:
        for number, each in enumerate(pool.map(partial(answer, asked.seed), range(asked.sets)), 1):
            answers += [] if each is None else [each]
            if number % 20 == 0:
                spent_s = time.monotonic() - began_s
                print(f"{number} of {asked.sets} sets, {spent_s:.0f} s", file=sys.stderr)
    write(answers, asked.out)
    off = told(answers)
    return int(off > MOST_OFF)


def told(answers: list[Answer]) -> float:
    """Print the table; the mean distance of stated from right, over all sets."""
    stated = np.array([p for each in answers for p, _ in each.stated])
    right = np.array([hit for each in answers for _, hit in each.stated])
    print(f"{len(answers)} sets; stated probability of the verdict, and how often it was right:")
    off = 0.0
    for low, high in pairwise(BINS):
        here = (stated > low) & (stated <= high)
        if here.any():
            off += abs(float(np.sum(stated[here] - right[here])))
            mean, share = stated[here].mean(), right[here].mean()
            print(f"  {low:4g} to {high:4g}: {here.sum():4d} sets, {mean:.3f} stated, {share:.3f}")
    wrong = sum(
        each.decision.verdict == "effect_found" and not each.stated[0][1] for each in answers
    )
    named = sum(each.decision.verdict == "effect_found" for each in answers)
    print(f"{named} named, {wrong} of them wrongly; off by {off / len(answers):.3f} in the mean")
    return off / len(answers)


def write(answers: list[Answer], path: Path) -> None:
    """Every set as a row."""
    with path.open("w", newline="", encoding="utf-8") as file:
        rows = csv.writer(file)
        rows.writerow(("set", "plan", "true", "verdict", "names", "listed", "stated", "right"))
        for number, truth, decision, ((p, hit),) in answers:
            listed = "+".join(n for alike in decision.group.values() for n in alike)
            names = "+".join(decision.names)
            true = "+".join(truth.names)
            row = (number, truth.about, true, decision.verdict, names, listed, f"{p:.4f}", int(hit))
            rows.writerow(row)


if __name__ == "__main__":
    sys.exit(main())
