"""Configuration files: read, and what is wrong with them; `rig_config` says what a rig's file may say.

An unknown key is an error that offers the nearest one.
"""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any, Literal, TypeVar, get_args, get_origin

from pydantic import BaseModel, ValidationError

from haptic_driver.config_folders import config_dirs, config_names, find_config, texture_dirs
from haptic_driver.errors import BadInputError
from haptic_driver.files import read_text
from haptic_driver.rig_config import NiForceSensorConfig, RecordedFingerConfig, RigConfig
from model.description import ModelDescription, read_model
from model.support.errors import ModelError, nearest

__all__ = [
    "RigConfig",
    "config_dirs",
    "config_names",
    "find_config",
    "load_model",
    "load_rig",
    "parse",
    "read_toml",
    "texture_dirs",
]


def load_rig(name_or_path: str) -> RigConfig:
    """A rig by the name of its file in `configs/rigs/`, or by path."""
    path = find_config(name_or_path, "rigs")
    return _with_whole_paths(parse(RigConfig, read_toml(path), str(path)), path.parent)


def _with_whole_paths(rig: RigConfig, folder: Path) -> RigConfig:
    """Files that a rig's file names are looked for beside it."""
    changed: dict[str, Any] = {}
    if isinstance(sensor := rig.force_sensor, NiForceSensorConfig):
        changed["force_sensor"] = sensor.model_copy(update={"calibration_file": str(folder / sensor.calibration_file)})
    if isinstance(tracker := rig.finger_tracker, RecordedFingerConfig):
        changed["finger_tracker"] = tracker.model_copy(update={"file": str(folder / tracker.file)})
    return rig.model_copy(update=changed)


def load_model(name_or_path: str) -> ModelDescription:
    """A model by the name of its file in `configs/models/`, or by path."""
    path = find_config(name_or_path, "models")
    try:
        return read_model(path)
    except ModelError as error:
        raise BadInputError("bad_model", error.message, error.hint) from error


Parsed = TypeVar("Parsed", bound=BaseModel)


def parse(schema: type[Parsed], content: dict[str, Any], where: str) -> Parsed:
    """`content` as `schema`; BadInputError names file, key and the nearest valid choice for the first mistake."""
    try:
        return schema.model_validate(content)
    except ValidationError as error:
        first = next((e for e in error.errors() if e["type"] == "extra_forbidden"), error.errors()[0])
        loc = [str(part) for part in first["loc"]]
        key = ".".join(_written(schema, loc)) or "the file"
        if first["type"] == "extra_forbidden":
            known = _fields_at(schema, loc[:-1])
            raise BadInputError("unknown_key", f"{where}: unknown key '{key}'", nearest(loc[-1], known)) from error
        if first["type"] in ("missing", "union_tag_not_found"):
            missing = f"{key}.kind" if first["type"] == "union_tag_not_found" else key
            raise BadInputError("bad_config", f"{where}: {missing} is missing", "Add it") from error
        if first["type"] == "union_tag_invalid":
            kinds = list(_variants(_annotation(schema, loc)))
            said = f"{where}: {key}.kind is {first['ctx']['tag']!r}"
            raise BadInputError("bad_config", said, nearest(str(first["ctx"]["tag"]), kinds)) from error
        said = first["msg"].removeprefix("Value error, ")
        given = "" if first["type"] == "value_error" else f", not {first['input']!r}"
        raise BadInputError("bad_config", f"{where}: {key}: {said}{given}", "Correct this key") from error


def _written(schema: type[BaseModel], loc: list[str]) -> list[str]:
    """A place in the file as its writer sees it: without the names of variants that pydantic puts in between."""
    return [key for i, key in enumerate(loc) if i == 0 or key not in _variants(_annotation(schema, loc[:i]))]


def _fields_at(schema: type[BaseModel], loc: list[str]) -> list[str]:
    """The keys that the section at `loc` knows."""
    section = _annotation(schema, loc)
    return list(section.model_fields) if isinstance(section, type) and issubclass(section, BaseModel) else []


def _annotation(schema: Any, loc: list[str]) -> Any:
    """What may stand at `loc`: a section, a union of sections, or anything else."""
    for key in loc:
        variants = _variants(schema)
        if key in variants:
            schema = variants[key]
            continue
        sections = [t for t in _members(schema) if isinstance(t, type) and issubclass(t, BaseModel)]
        fields = sections[0].model_fields if len(sections) == 1 else {}
        schema = fields[key].annotation if key in fields else None
    sections = [t for t in _members(schema) if isinstance(t, type) and issubclass(t, BaseModel)]
    return sections[0] if len(sections) == 1 else schema


def _variants(annotation: Any) -> dict[str, Any]:
    """The sections of a union by their `kind`; none for anything else."""
    variants: dict[str, Any] = {}
    for member in _members(annotation):
        fields = getattr(member, "model_fields", {})
        if "kind" in fields and get_origin(fields["kind"].annotation) is Literal:
            variants |= dict.fromkeys(get_args(fields["kind"].annotation), member)
    return variants if len(variants) > 1 else {}


def _members(annotation: Any) -> list[Any]:
    """A type, or those of a union, through `Annotated`."""
    inner = get_args(annotation)
    is_union = bool(inner) and not isinstance(annotation, type) and get_origin(annotation) not in (list, dict, Literal)
    return [member for part in inner for member in _members(part)] if is_union else [annotation]


def read_toml(path: Path) -> dict[str, Any]:
    """The content of a TOML file; BadInputError says what is wrong with it."""
    try:
        return tomllib.loads(read_text(path))
    except (ValueError, RecursionError) as error:  # ValueError: also a number of thousands of digits
        raise BadInputError("bad_toml", f"{path}: {error}", "Correct the TOML syntax there") from error
