"""`make forms`: how much of a gap effects in other forms close, and wrong ones, as `forms.csv`.

python -m tests.forms [--out FILE.csv] [--workers N]

All are the blind generator's, clearly visible to all witnesses. To a form of an effect, the
catalogue's is fitted; to a stranger, whichever effect has the most evidence.
"""

from __future__ import annotations

import argparse
import csv
import tempfile
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import cpu_count
from pathlib import Path

from haptic_driver.lookup.models import load_model
from model.diagnosis.audit import audited
from model.diagnosis.data import Measurements, read_measurements
from model.diagnosis.forms import FILE, Row, catalogue_hash
from model.diagnosis.proof import prove
from model.diagnosis.setting import fitted
from tests.blind.generator.__main__ import csv_text
from tests.blind.generator.build import Spec
from tests.blind.generator.effects import (
    ALTERNATIVE,
    CATALOGUE,
    CATALOGUE_EFFECTS,
    FIRST_STRANGERS,
    SECOND,
    SECOND_STRANGERS,
)
from tests.blind.generator.families import WITNESSES
from tests.blind.generator.witnesses import build_pair

# The third ones are held out.
STRANGERS = FIRST_STRANGERS | SECOND_STRANGERS
NAMES = (*CATALOGUE_EFFECTS, *STRANGERS)
FORMS = [(name, form) for name in CATALOGUE_EFFECTS for form in (ALTERNATIVE, SECOND)]
ALL = [*FORMS, *((name, CATALOGUE) for name in STRANGERS)]
LAMBDA, SEED = 1000.0, 77


def row(what: tuple[str, str]) -> Row:
    """What the catalogue's form, or the best of its effects, closes of one gap."""
    (name, form), description, data = what, load_model("reference"), observed(*what)
    setting = fitted(description, audited(description, data), lambda _: None)
    right = [single for single in setting.singles if single.name == name]
    best = max(right or setting.singles, key=lambda single: single.alone.log_evidence)
    noise, scale = setting.problem.noise, best.beside_discrepancy.scale
    proof = prove(description, setting.data, noise, best, [], scale, 0, lambda _: None)
    return Row(name, form, proof.gap_closed)


def observed(name: str, form: str) -> Measurements:
    """What a rig would measure of a finger with this."""
    spec = Spec("W1", NAMES.index(name), ((name, LAMBDA),), form, design=WITNESSES)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "set.csv"
        path.write_text(csv_text(build_pair(spec, SEED)[0].columns), encoding="utf-8")
        return read_measurements(path)


def main() -> None:
    parser = argparse.ArgumentParser(description="What other forms leave of a gap.")
    parser.add_argument("--out", type=Path, default=FILE)
    parser.add_argument("--workers", type=int, default=cpu_count())
    asked = parser.parse_args()
    with ProcessPoolExecutor(asked.workers) as pool:
        found = list(pool.map(row, ALL))
    with asked.out.open("w", encoding="utf-8", newline="") as file:
        file.write(f"# make forms, catalogue {catalogue_hash()}\n")
        rows = csv.writer(file, lineterminator="\n")
        rows.writerow(Row._fields)
        rows.writerows((one.name, one.form, f"{one.closed:.3f}") for one in found)


if __name__ == "__main__":
    main()
