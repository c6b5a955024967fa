"""Timed target scripts: tables of steps -> a script that the render stage plays."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any

from haptic_driver.errors import BadInputError
from haptic_driver.render.texture import Interpolation, Script, Step, Texture, Uniform
from haptic_driver.textures.description import (
    LONGEST_TABLE_ROWS,
    SCRIPT_HINT,
    ScriptDescription,
    StepDescription,
    parse_step,
)
from haptic_driver.textures.sources import PROFILE_HINT
from model.support.errors import did_you_mean
from model.support.tables import read_table

COLUMNS = ("time_s", "cof", "texture", "interpolation", "label")
NUMBERS = ("time_s", "cof")
EITHER_HINT = f"{PROFILE_HINT}; or, for a script, time_s,cof"
POSITIONS = ("position_m", "position_mm")  # of a profile


def is_script(path: Path) -> bool:
    """Whether the first line of a CSV file has a column of times."""
    table = read_table(path, [], EITHER_HINT, LONGEST_TABLE_ROWS, [*COLUMNS, *POSITIONS])
    return "time_s" in table.columns


def build(described: ScriptDescription, path: Path, load: Callable[[str], Texture]) -> Script:
    """The script of a description in the file `path`; `load` finds a texture by name."""
    if described.file is not None:
        return read(path.parent / described.file, load, described.interpolation)
    assert described.step is not None  # the description has the one or the other
    where = [f"{path}, step {number + 1}" for number in range(len(described.step))]
    return _script(
        path, list(zip(where, described.step, strict=True)), load, described.interpolation
    )


def read(
    path: Path, load: Callable[[str], Texture], interpolation: Interpolation = "hold"
) -> Script:
    """The script in a CSV file with columns time_s, cof or texture, and if you like label and
    interpolation.
    """
    table = read_table(path, ["time_s"], SCRIPT_HINT, LONGEST_TABLE_ROWS, COLUMNS)
    for name in table.columns:
        if name not in COLUMNS:
            said = f"{path}: unknown column '{name}'"
            raise BadInputError("bad_script", said, did_you_mean(name, list(COLUMNS)) + SCRIPT_HINT)
    steps = []
    for row, cells in enumerate(table.rows):
        given: dict[str, Any] = {column: text for column, text in cells.items() if text}
        given |= {column: table.number(row, column) for column in NUMBERS if column in given}
        steps.append((table.where(row), parse_step(given, table.where(row))))
    return _script(path, steps, load, interpolation)


def _script(
    path: Path,
    steps: Sequence[tuple[str, StepDescription]],
    load: Callable[[str], Texture],
    interpolation: Interpolation,
) -> Script:
    if len(steps) < 2:
        raise BadInputError(
            "bad_script", f"{path}: fewer than two steps", "the last step says when the script ends"
        )
    for (_, before), (where, step) in pairwise(steps):
        if step.time_s <= before.time_s:
            said = f"{where}: time_s {step.time_s:g} comes after {before.time_s:g}"
            raise BadInputError("bad_script", said, "sort the steps by time")
    load_once = cache(load)
    return Script(
        tuple(
            Step(
                step.time_s,
                _texture(where, step, load_once),
                step.interpolation or interpolation,
                step.label,
            )
            for where, step in steps
        )
    )


def _texture(where: str, step: StepDescription, load: Callable[[str], Texture]) -> Texture:
    if step.cof is not None:
        return Uniform(step.cof)
    try:
        return load(str(step.texture))
    except BadInputError as error:
        raise BadInputError(error.code, f"{where}: {error.message}", error.hint) from None
