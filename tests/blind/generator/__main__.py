"""Write blind sets: python -m tests.blind.generator --out DIR --seed N --scale 0.1 [--ci].

With --second or --third: those alternatives and their ten strangers alone. Without counts,
these are 252 sets: 126 fingers with all witnesses, and the same with friction
alone.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path

import numpy as np

from .build import BlindSet, Spec, build, build_twins
from .effects import SECOND, THIRD
from .families import COUNTS, SECOND_COUNTS, WITNESSES, anew, as_measured, ci_specs, specs
from .witnesses import build_pair

CI_SEED = 20231
WHOLE = {"session", "trial"}


def _cell(name: str, x: float | str) -> str:
    if isinstance(x, str):
        return x
    return f"{int(x)}" if name in WHOLE else "" if np.isnan(x) else f"{x:.6g}"


def csv_text(columns: dict[str, np.ndarray]) -> str:
    """One line per row, numbers with six digits."""
    table = [[_cell(name, x) for x in values] for name, values in columns.items()]
    lines = [",".join(columns)] + [",".join(cells) for cells in zip(*table, strict=True)]
    return "\n".join(lines) + "\n"


def write(sets: list[BlindSet], out: Path, seed: int) -> None:
    """Number the sets in shuffled order, so that a file's name says nothing, and seal the labels by
    their hash.
    """
    folder = out / "sets"
    folder.mkdir(parents=True, exist_ok=True)
    for left_over in folder.glob("*.csv"):
        left_over.unlink()
    order = _shuffled(sets, np.random.default_rng([seed, 5]))
    digits = max(3, len(str(len(sets))))
    labels = {}
    for place, which in enumerate(order, start=1):
        name = f"{place:0{digits}d}.csv"
        (folder / name).write_text(csv_text(sets[which].columns), encoding="utf-8")
        labels[name] = sets[which].label
    text = json.dumps(labels, indent=1) + "\n"
    (out / "labels.json").write_text(text, encoding="utf-8")
    digest = hashlib.sha256(text.encode()).hexdigest()
    (out / "labels.sha256").write_text(f"{digest}  labels.json\n", encoding="utf-8")


def _shuffled(sets: list[BlindSet], rng: np.random.Generator) -> np.ndarray:
    """An order of the sets in which twins follow one another, whichever first."""
    if not all("pair" in made.label for made in sets):
        return rng.permutation(len(sets))
    pairs = rng.permuted(np.arange(len(sets)).reshape(-1, 2), axis=1)
    return rng.permutation(pairs).ravel()


def generate(wanted: list[Spec], seed: int, workers: int = 1) -> list[BlindSet]:
    """Build the sets, in order, on `workers` processes.

    Those of witnesses come with a twin of friction alone, measured ones with a twin of commanded
    loads.
    """
    one = partial(_sets, seed=seed)
    if workers == 1:
        return [made for spec in wanted for made in one(spec)]
    with ProcessPoolExecutor(workers) as pool:
        return [made for sets in pool.map(one, wanted) for made in sets]


def _sets(spec: Spec, seed: int) -> list[BlindSet]:
    if spec.design == WITNESSES:
        return build_pair(spec, seed)
    return build_twins(spec, seed) if spec.measured else [build(spec, seed)]


def _options(argv: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m tests.blind.generator", description=__doc__)
    parser.add_argument(
        "--out", type=Path, required=True, help="folder for sets/, labels.json and labels.sha256"
    )
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--scale", type=float, default=0.1, help="share of the full counts")
    parser.add_argument(
        "--counts", default="", help="exact numbers instead of --scale, as F0=15,F1=33"
    )
    which = parser.add_mutually_exclusive_group()
    for form in (SECOND, THIRD):
        which.add_argument(
            f"--{form}",
            dest="form",
            action="store_const",
            const=form,
            help=f"{form} alternatives and strangers alone",
        )
    parser.add_argument(
        "--ci",
        action="store_true",
        help="the five fixed sets; all but --out and --workers is ignored",
    )
    parser.add_argument(
        "--measured",
        action="store_true",
        help="loads as measured, gains of trials and drifts in them, each set with a twin that has"
        " none of these; families F only",
    )
    parser.add_argument("--workers", type=int, default=min(2, os.cpu_count() or 1))
    options = parser.parse_args(argv)
    named = [n.partition("=")[0] for n in options.counts.split(",") if n]
    if unknown := sorted(set(named) - set(COUNTS)):
        parser.error(f"unknown families {unknown}; known are {list(COUNTS)}")
    return options


def main(argv: list[str] | None = None) -> None:
    options = _options(argv)
    seed = CI_SEED if options.ci else options.seed
    if options.ci:
        wanted = ci_specs()
    else:
        exact = {
            n: int(c)
            for n, _, c in (item.partition("=") for item in options.counts.split(",") if item)
        }
        if options.form:
            exact = exact or SECOND_COUNTS
        wanted = specs(seed, options.scale, exact or None)
        wanted = [anew(spec, options.form) for spec in wanted] if options.form else wanted
        if options.measured:
            wanted = [as_measured(spec) for spec in wanted if spec.family.startswith("F")]
    sets = generate(wanted, seed, options.workers)
    write(sets, options.out, seed)
    print(f"{len(sets)} sets in {options.out / 'sets'}")


if __name__ == "__main__":
    main()
