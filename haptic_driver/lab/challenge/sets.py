"""The folder of a challenge: sets of measured data, their data sheet, and what is hidden in them.

The sets are made by the test tree's generator, which a clone of the repository has and an
installation has not.
"""

from __future__ import annotations

import hashlib
import importlib
import importlib.util
import json
import sys
from collections.abc import Callable, Collection, Mapping
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from haptic_driver.config import Section, parse
from haptic_driver.errors import BadInputError, HapticError
from haptic_driver.files import require_free, write_text
from haptic_driver.lab.challenge.scores import Truth
from model.effects import CATALOGUE
from model.support.arrays import Array
from model.support.reading import read_bytes, read_text

ROOT = Path(__file__).resolve().parents[3]
PACKAGE = "haptic_challenge_generator"
MAKE = "Make the challenge again in another folder"
Advance = Callable[[int], None]


class About(Section):
    """`challenge.json`: how the sets were made, and the SHA-256 of each file."""

    seed: int
    friction_alone: bool
    files: dict[str, str]


def generator(root: Path = ROOT) -> ModuleType:
    """What makes the sets; HapticError where the test tree is not beside the program."""
    folder = root / "tests" / "blind" / "generator"
    if not (folder / "challenge.py").is_file():
        raise HapticError(
            "no_test_tree",
            f"the sets are made by the test tree, and {folder} is not there",
            "Run it in a clone of the repository",
        )
    if PACKAGE not in sys.modules:
        # by a name of its own: other packages may have a folder `tests` too
        found = importlib.util.spec_from_file_location(
            PACKAGE, folder / "__init__.py", submodule_search_locations=[str(folder)]
        )
        assert found is not None
        sys.modules[PACKAGE] = importlib.util.module_from_spec(found)
    return importlib.import_module(f"{PACKAGE}.challenge")


def make(folder: Path, about: tuple[int, int, bool], advance: Advance) -> About:
    """Write sets, settings to predict, data sheet and `challenge.json`; no label is written.

    `about`: seed, how many sets, and whether all are of friction alone.
    """
    seed, count, friction_alone = about
    kept = folder / "challenge.json"
    require_free(kept, option="DIR")
    source = generator()
    files = {}
    for i in range(count):
        name = f"{i + 1:03d}.csv"
        one = source.challenge_set(i, seed, friction_alone)
        text = source.csv_text(one.columns)
        write_text(folder / "sets" / name, text)
        write_text(
            unseen_of(folder / "sets" / name), source.csv_text(source.unseen(one, i, seed)[0])
        )
        files[name] = _hash(text.encode())
        advance(i + 1)
    made = About(seed=seed, friction_alone=friction_alone, files=files)
    physics = {kind.name: kind.physics for kind in CATALOGUE}
    write_text(folder / "README.md", source.data_sheet(count, physics))
    write_text(kept, made.model_dump_json(indent=1) + "\n")
    return made


def unseen_of(path: Path) -> Path:
    """The file with the settings that were not measured, from that of a set."""
    return path.parent.parent / "unseen" / path.name


def read_about(folder: Path) -> About:
    """How the sets of a folder were made; BadInputError where a file of them has changed."""
    kept = folder / "challenge.json"
    try:
        content = json.loads(read_text(kept))
    except (ValueError, RecursionError) as error:
        raise BadInputError("bad_challenge", f"{kept}: is not JSON: {error}", MAKE) from None
    about = parse(About, content, str(kept), "bad_challenge")
    for name, expected in about.files.items():
        path = folder / "sets" / name
        if _hash(read_bytes(path)) != expected:
            said = f"{path}: is not as it was made"
            raise BadInputError("changed_set", said, f"Restore it. {MAKE}")
    return about


def columns_of(folder: Path, about: About) -> dict[str, Collection[str]]:
    """The columns of each set."""
    return {
        name: read_text(folder / "sets" / name).partition("\n")[0].split(",")
        for name in about.files
    }


def truths(about: About, advance: Advance) -> dict[str, Truth]:
    """What is hidden in each set, made again; HapticError where it comes out otherwise now."""
    source = generator()
    found = {}
    for i, (name, expected) in enumerate(about.files.items()):
        made = source.challenge_set(i, about.seed, about.friction_alone)
        if _hash(source.csv_text(made.columns).encode()) != expected:
            said = f"{name}: another version of the generator made it"
            raise HapticError("another_generator", said, f"Score with that version. {MAKE}")
        found[name] = _truth(made, source.unseen(made, i, about.seed), source.FINGER)
        advance(i + 1)
    return found


def _truth(made: Any, unseen: tuple[Any, Array, Array], finger: Mapping[str, str]) -> Truth:
    """The truth of the rows of friction, from a set of the generator and its settings that were not
    measured. It calls the numbers of a `finger` otherwise.
    """
    _, there, without = unseen
    effects = made.label["effects"]
    rows = np.isfinite(made.columns["cof"])
    columns = {name: values[rows] for name, values in made.columns.items()}
    return Truth(
        effects=frozenset(effect["name"] for effect in effects),
        in_catalogue=not any(effect["stranger"] for effect in effects),
        visibility=min((effect["lambda"] for effect in effects), default=0.0),
        columns=columns,
        change=made.change[rows],
        noise=columns["cof_std"] / columns["cof"],
        finger={name: made.label["finger"][theirs] for name, theirs in finger.items()},
        unseen=there,
        unseen_change=there / without - 1.0,
    )


def _hash(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()
