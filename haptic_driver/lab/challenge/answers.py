"""What somebody answers to the sets of a challenge: JSON that a person can write by hand."""

from __future__ import annotations

import json
from collections.abc import Collection, Iterable, Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, FiniteFloat

from haptic_driver.config import Section, parse
from haptic_driver.errors import BadInputError
from model.effects import BY_NAME
from model.support.errors import nearest
from model.support.reading import read_text

AXES = ("frequency_hz", "voltage_v", "normal_force_n", "speed_m_s", "time_s", "session", "trial")
FINGER = ("cof_off", "roughness_rms_m", "skin_thickness_m", "leak_scale", "contact_area_m2")
Range = Annotated[list[FiniteFloat], Field(min_length=2, max_length=2)]
Positive = Annotated[FiniteFloat, Field(gt=0.0)]
UNSEEN = 24  # settings of each set that were not measured
Predicted = Annotated[list[Positive], Field(min_length=UNSEEN, max_length=UNSEEN)]
ValueAndStd = Annotated[list[Positive], Field(min_length=2, max_length=2)]
Region = Annotated[dict[str, Range], Field(min_length=1)]
CODE = "bad_answers"


class Answer(Section):
    """What is said of one set; whatever is None is not answered.

    `probability` is that of the verdict. `where` are regions of the rows in which friction is
    changed, each a range of some columns, both ends included. `strength` is the root mean square of
    the relative change of friction. `finger` has numbers of FINGER, each with its standard
    deviation. `predicted` is friction at the settings that were not measured.
    """

    verdict: Literal["named", "listed", "unknown", "nothing"] | None = None
    effects: list[str] = Field(default_factory=list)
    probability: float | None = Field(default=None, ge=0.0, le=1.0)
    where: list[Region] | None = None
    strength: float | None = Field(default=None, ge=0.0, allow_inf_nan=False)
    finger: dict[str, ValueAndStd] | None = None
    predicted: Predicted | None = None


def read_answers(path: Path, columns: Mapping[str, Collection[str]]) -> dict[str, Answer]:
    """The answers of a file to sets, of which `columns` are known; BadInputError names what is
    wrong, and where.
    """
    said = _content(path)
    found = {}
    for name, content in said.items():
        if name not in columns:
            hint = nearest(name, list(columns))
            raise BadInputError(CODE, f"{path}: there is no set '{name}'", hint)
        where = f"{path}: {name}"
        if not isinstance(content, dict):
            raise BadInputError(CODE, f"{where}: is no object", 'Such as {"verdict": "nothing"}')
        found[name] = parse(Answer, content, where, CODE)
        _check_known(found[name].effects, list(BY_NAME), f"{where}: there is no effect")
        _check_known(found[name].finger or (), list(FINGER), f"{where}: a finger has no")
        _check_verdict(found[name], where)
        _check_regions(found[name], where, columns[name])
    return found


def _content(path: Path) -> dict[str, Any]:
    try:
        content = json.loads(read_text(path), object_pairs_hook=_each_once)
    except (ValueError, RecursionError) as error:
        hint = "Write it as the README.md beside the data shows"
        raise BadInputError(CODE, f"{path}: cannot be read: {error}", hint) from None
    if not isinstance(content, dict):
        said = f"{path}: is no object with an answer to each set"
        raise BadInputError(CODE, said, 'Such as {"001.csv": {"verdict": "nothing"}}')
    return content


def _each_once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """An object of a file in which no key stands twice: one of two answers would be lost."""
    found = dict(pairs)
    if len(found) < len(pairs):
        twice = next(key for i, (key, _) in enumerate(pairs) if key in dict(pairs[:i]))
        raise ValueError(f"'{twice}' stands there twice")
    return found


def _check_known(names: Iterable[str], known: list[str], said: str) -> None:
    for name in names:
        if name not in known:
            raise BadInputError(CODE, f"{said} '{name}'", nearest(name, known))


def _check_verdict(answer: Answer, where: str) -> None:
    with_names = answer.verdict in ("named", "listed")
    if with_names != bool(answer.effects):
        said = f"{where}: verdict {answer.verdict or 'none'} with {len(answer.effects)} effects"
        hint = "named and listed have effects; unknown and nothing have none"
        raise BadInputError(CODE, said, hint)


def _check_regions(answer: Answer, where: str, columns: Collection[str]) -> None:
    axes = [axis for axis in AXES if axis in columns]
    for region in answer.where or ():
        for axis, (low, high) in region.items():
            if axis not in axes:
                said = f"{where}: where: '{axis}' is no column to say a region by"
                raise BadInputError(CODE, said, nearest(axis, axes))
            if low > high:
                said = f"{where}: where: {axis} from {low:g} to {high:g} is empty"
                raise BadInputError(CODE, said, "Give [low, high]")
