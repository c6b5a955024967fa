"""`make forms`: how far forms of effects, and strangers, are from the catalogue, as `forms.csv`.

python -m tests.forms [--out FILE.csv] [--workers N]

All are the blind generator's, clearly visible to all witnesses. To a form of an effect, the
catalogue's is fitted; to a stranger, whichever effect has the most evidence. An error of form is
that which makes what is left most probable.
"""

from __future__ import annotations

import argparse
import csv
import tempfile
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import cpu_count
from pathlib import Path

import numpy as np
from scipy.special import logsumexp

from haptic_driver.lookup.models import load_model
from model.diagnosis.audit import audited
from model.diagnosis.data import Measurements, read_measurements
from model.diagnosis.evidence import log_marginal
from model.diagnosis.form import form_terms
from model.diagnosis.forms import EXACT, FILE, WAYS, Row, catalogue_hash
from model.diagnosis.model_fit import Fit, Problem
from model.diagnosis.proof import prove
from model.diagnosis.setting import fitted
from tests.blind.generator.__main__ import csv_text
from tests.blind.generator.build import Spec
from tests.blind.generator.effects import (
    ALTERNATIVE,
    CATALOGUE,
    CATALOGUE_EFFECTS,
    SECOND,
    STRANGERS,
)
from tests.blind.generator.families import WITNESSES
from tests.blind.generator.witnesses import build_pair

NAMES = (*CATALOGUE_EFFECTS, *STRANGERS)
FORMS = [(name, form) for name in CATALOGUE_EFFECTS for form in (ALTERNATIVE, SECOND)]
ALL = [*FORMS, *((name, CATALOGUE) for name in STRANGERS)]
LAMBDA, SEED = 1000.0, 77
SHARES = (0.003, 0.006, 0.0125, 0.025, 0.05, 0.1, 0.2, 0.4, 0.8, 1.6)
REFITS = 3  # about a form that is off


def row(what: tuple[str, str]) -> Row:
    """What the catalogue's form, or the best of its effects, makes of one thing."""
    (name, form), description, data = what, load_model("reference"), observed(*what)
    setting = fitted(description, audited(description, data), lambda _: None)
    noise, singles = setting.problem.noise, setting.singles
    best = max(singles, key=lambda single: (single.name == name, single.alone.log_evidence))
    scale = best.beside_discrepancy.scale
    proof = prove(description, setting.data, noise, best, [], scale, 0, lambda _: None)
    way, share = ("", 0.0) if name in STRANGERS else error_of(setting.problem, best.fit)
    return Row(name, form, way, share, proof.gap_closed)


def observed(name: str, form: str) -> Measurements:
    """What a rig would measure of a finger with this."""
    spec = Spec("W1", NAMES.index(name), ((name, LAMBDA),), form, design=WITNESSES)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "set.csv"
        path.write_text(csv_text(build_pair(spec, SEED)[0].columns), encoding="utf-8")
        return read_measurements(path)


def error_of(problem: Problem, fit: Fit) -> tuple[str, float]:
    """In which way a fitted form is off, and by what share.

    It is exact where that is more probable than an error of which only the way is known.
    """
    exact = log_marginal(fit.residual + fit.jacobian @ fit.vector, fit.jacobian, problem.noise)
    ways = WAYS[: len(form_terms(problem, fit))]
    logs, share, way = max((*best_share(problem, fit, i), way) for i, way in enumerate(ways))
    return (way, share) if logs > exact else (EXACT, 0.0)


def best_share(problem: Problem, fit: Fit, way: int) -> tuple[float, float]:
    """log evidence of one way, and the most probable of SHARES.

    Where a form is off, the finger makes up for it: it is fitted anew beside that.
    """
    found = []
    for _ in range(REFITS):
        form, target = form_terms(problem, fit)[way], fit.residual + fit.jacobian @ fit.vector
        spreads = [np.hstack([fit.jacobian, share * form]) for share in SHARES]
        logs = [log_marginal(target, spread, problem.noise) for spread in spreads]
        share = SHARES[int(np.argmax(logs))]
        found.append((float(logsumexp(logs) - np.log(len(logs))), share))
        fit = problem.refitted(fit, share * form)
    return max(found)


def main() -> None:
    parser = argparse.ArgumentParser(description="How far other forms are from the catalogue's.")
    parser.add_argument("--out", type=Path, default=FILE)
    parser.add_argument("--workers", type=int, default=cpu_count())
    asked = parser.parse_args()
    with ProcessPoolExecutor(asked.workers) as pool, asked.out.open("w", encoding="utf-8") as file:
        file.write(f"# make forms, catalogue {catalogue_hash()}\n")
        rows = csv.writer(file, lineterminator="\n")
        rows.writerow(Row._fields)
        for one in pool.map(row, ALL):
            rows.writerow((*one[:3], f"{one.share:g}", f"{one.closed:.3f}"))
            file.flush()


if __name__ == "__main__":
    main()
