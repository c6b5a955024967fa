"""A course's exercises: a simulated finger for each student, with one effect hidden or none.

It is sealed in the rig's file. Answers are marked by the rules of the challenge.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from pydantic import Field

from haptic_driver.config import Section, parse
from haptic_driver.errors import BadInputError
from haptic_driver.files import replacing, write_text
from haptic_driver.lab.challenge.answers import AXES, CODE, Answer, read_answers
from haptic_driver.lab.challenge.scores import Judged, Truth, is_right, scores
from haptic_driver.lab.measuring.benches import bench_for
from haptic_driver.lab.measuring.data_file import DataFile
from haptic_driver.lab.measuring.plan import Plan, load_plan
from haptic_driver.lab.measuring.run import prepare, run
from haptic_driver.lab.studies import load_study
from haptic_driver.lookup.models import load_model
from haptic_driver.rig.config import RigConfig, load_rig
from haptic_driver.rig.sealed import Hidden, seal
from haptic_driver.simulation.finger_model import with_hidden
from haptic_driver.simulation.twin import file_of
from model.conditions import Conditions
from model.effects import CATALOGUE
from model.support.arrays import Array
from model.support.reading import read_text
from model.touch_model import TouchModel

MODEL, RIG, FINGERS = "reference", "simulated", "fingers"
NOTHING = 0.15  # share of students with nothing hidden, as in a challenge
SEEN = 0.05, 0.3  # spread of ln friction over the plan that what is hidden makes; judged
DRAWS = 20  # of one effect's parameters, before another is taken
HEAD = "# An exercise: the finger of this simulated rig may have one effect that the model lacks.\n"
SHEET = """# Exercise {0}

The finger of `rig.toml` may have one effect that the model lacks. Which one is it, or is there
none? `data.csv` was measured on it.

    haptic demo --rig rig.toml --out out/demo
    haptic demo --rig rig.toml --no-feedback --out out/without
    haptic diagnose data.csv --model reference --out out/diagnosis
    haptic measure --rig rig.toml --plan witnesses --out out/more.csv

Feedback closes what is missing, as far as the finger reaches; `--no-feedback` shows it.

Write `answers.json`:

    {{"{0}": {{"verdict": "named", "effects": ["NAME"], "probability": 0.9}}}}

- `verdict`: `named` (this effect), `listed` (one of these), `unknown` (something of no catalogue)
  or `nothing`; the last two have no `effects`.
- `probability`: that the verdict is true.
"""


class Key(Section):
    """`key.json`, for the lecturer alone: what is hidden, by student."""

    seed: int
    plan: str
    students: dict[str, Hidden] = Field(min_length=1)


class Mark(NamedTuple):
    """One student: what was hidden, what was answered, and what that is worth."""

    hidden: list[str]
    answer: Answer
    mark: str
    right: bool


def make(folder: Path, about: tuple[int, int, str], advance: Callable[[int], object]) -> Key:
    """Write the key, and a folder with rig, data and task for each student. `about`: seed, number
    of students, and plan of the data.
    """
    seed, count, plan_name = about
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        said = f"{folder}: is there already, and not empty"
        raise BadInputError("file_exists", said, "Give another DIR")
    plan, rig = load_plan(plan_name), load_rig(RIG)
    names = [f"{i + 1:02d}" for i in range(count)]
    settings = prepare(rig, TouchModel(load_model(MODEL)), plan).points
    felt = np.array([s[:4] for s in settings if not s.sweep])
    drawn = _slowly(seed)
    students = {name: _drawn(drawn, i, felt) for i, name in enumerate(names)}
    key = Key(seed=seed, plan=plan_name, students=students)
    with replacing(folder / "key.json") as part:
        part.touch(mode=0o600)
        part.write_text(key.model_dump_json(indent=1) + "\n", encoding="utf-8")
    for i, (name, hidden) in enumerate(students.items()):
        noise = int(np.random.default_rng([drawn, i, 1]).integers(2**31))
        own = {"sealed": seal(hidden), "model": MODEL, "seed": noise}
        simulation = rig.simulation.model_copy(update=own)
        config = rig.model_copy(update={"name": f"exercise {name}", "simulation": simulation})
        home = folder / "students" / name
        write_text(home / "rig.toml", HEAD + file_of(config))
        write_text(home / "README.md", SHEET.format(name))
        _measure(config, plan, noise, home / "data.csv")
        advance(i + 1)
    return key


def _slowly(seed: int) -> int:
    """What all is drawn from. Files say numbers that are drawn, so guesses of the lecturer's seed
    can be tried: each takes a tenth of a second.
    """
    cost = {"n": 2**15, "r": 8, "p": 1, "maxmem": 2**26}
    return int.from_bytes(hashlib.scrypt(f"{seed}".encode(), salt=b"exercise", dklen=8, **cost))


def _drawn(seed: int, i: int, felt: Array) -> Hidden:
    """A finger of the population and what is hidden in it. It shows in friction at the conditions
    `felt` [n, 4] of frequency, voltage, load and speed.
    """
    rng, study = np.random.default_rng([seed, i]), load_study(FINGERS)
    fingers = replace(study, plan=study.plan.model_copy(update={"seed": seed % 2**31}))
    finger = {name: float(f"{value:.4g}") for name, value in fingers.finger(i).items()}
    if rng.random() < NOTHING:
        return Hidden(finger=finger)
    model = TouchModel(load_model(MODEL).with_values(**finger))
    plain = _ln_friction(model, felt)
    while True:
        kind = CATALOGUE[rng.integers(len(CATALOGUE))]
        asked = kind.asked(())
        for _ in range(DRAWS):
            drawn = {p.name: float(p.from_normal(rng.standard_normal())) for p in asked}
            hide = {kind.name: {name: float(f"{value:.4g}") for name, value in drawn.items()}}
            change = _ln_friction(with_hidden(model, hide), felt) - plain
            if SEEN[0] <= np.std(change) <= SEEN[1]:
                return Hidden(hide=hide, finger=finger)


def _ln_friction(model: TouchModel, felt: Array) -> Array:
    f, v, n, s = felt.T
    return np.log(model.cof(Conditions(f, v, n, speed_m_s=s)))


def _measure(config: RigConfig, plan: Plan, seed: int, out: Path) -> None:
    touch = TouchModel(load_model(MODEL))
    experiment = prepare(config, touch, plan, seed)
    bench = bench_for(experiment, 0, None, lambda what: None)
    with DataFile.create(out, experiment.identity()) as data, bench:
        run(experiment, bench, data)


def read_key(folder: Path) -> Key:
    """The lecturer's key; BadInputError where it is none."""
    path = folder / "key.json"
    try:
        content = json.loads(read_text(path))
    except ValueError as error:
        hint = "Make the exercises again, by the same seed"
        raise BadInputError("bad_key", f"{path}: is not JSON: {error}", hint) from None
    return parse(Key, content, str(path), "bad_key")


class Marks(NamedTuple):
    """A mark for each student, the scores of all by the rules of the challenge, and why files that
    cannot be read were left out.
    """

    students: dict[str, Mark]
    total: dict[str, Any]
    left_out: list[str]


def marks(key: Key, files: Sequence[Path]) -> Marks:
    """Whatever is hidden counts as visible. Place, strength and numbers of the finger are not
    scored. BadInputError where no file can be read.
    """
    given: dict[str, Answer] = {}
    refused: list[BadInputError] = []
    for path in files:
        try:
            found = read_answers(path, dict.fromkeys(key.students, AXES))
        except BadInputError as error:
            refused.append(error)
            continue
        for name in found:
            if name in given:
                said = f"{path}: student {name} has answered in another file too"
                raise BadInputError(CODE, said, "Leave one of them out")
        given |= found
    if refused and len(refused) == len(files):
        raise refused[0]
    named = {"verdict", "effects", "probability"}
    answers = {name: Answer(**answer.model_dump(include=named)) for name, answer in given.items()}
    truths = {name: _truth(hidden) for name, hidden in key.students.items()}
    marked = {
        name: _mark(Judged(truth, answers.get(name, Answer()))) for name, truth in truths.items()
    }
    total = scores(answers, truths)
    kept = {part: total[part] for part in ("sets", "answered", "names", "calibration")}
    return Marks(marked, kept, [f"{error.message}. {error.hint}" for error in refused])


def _truth(hidden: Hidden) -> Truth:
    none = np.empty(0)
    return Truth(frozenset(hidden.hide), True, math.inf if hidden.hide else 0.0, {}, none, none)


def _mark(one: Judged) -> Mark:
    right = one.got.verdict is not None and is_right(one)
    match one.got.verdict:
        case None:
            said = "no answer"
        case "named":
            said = "named" if right else "wrong name"
        case "listed":
            said = "in the list" if right else "not in the list"
        case "nothing":
            said = "nothing hidden" if right else "overlooked"
        case "unknown":
            said = "left without a name"
    return Mark(sorted(one.truth.effects), one.got, said, right)
