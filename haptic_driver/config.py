"""Configuration files: where they are found, how they are read, and what is wrong with them.

An unknown key is an error that offers the nearest one. What a file may say stands where it is used.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import starmap
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar, get_args, get_origin

from pydantic import (
    BaseModel,
    ConfigDict,
    GetCoreSchemaHandler,
    RootModel,
    ValidationError,
    ValidatorFunctionWrapHandler,
)
from pydantic.fields import FieldInfo
from pydantic_core import CoreSchema, PydanticCustomError, core_schema

from haptic_driver.errors import BadInputError
from model.support.errors import did_you_mean, nearest

Parsed = TypeVar("Parsed", bound=BaseModel)
# What is written wrongly has a hint of its own; what is missing has none.
# Patterns of texts, and what they ask for in words.
PRINTABLE, URL = r"^[^\x00-\x1f]+$", r"^https?://"
PATTERNS = {PRINTABLE: "must be one line of printable characters", URL: "must begin with http://"}
TELLING = {"kind", "do"}  # keys that tell sections of a union apart
FIRST_SAID = {"extra_forbidden": 0, "union_tag_invalid": 1, "missing": 3, "union_tag_not_found": 3}


class Checked(BaseModel):
    """Base of what comes from outside, or goes there: frozen, and an unknown key is an error."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class Section(Checked):
    """Base of what stands in files: and nothing of the wrong type."""

    model_config = ConfigDict(strict=True)


@dataclass(frozen=True)
class Within:
    """As metadata of a float: its range, both ends included, and why nothing real lies outside.

    A figure that is not real may switch off the check that it is for: a limit of 1e308 allows
    everything.
    """

    low: float
    high: float
    why: str

    def __get_pydantic_core_schema__(
        self, source: Any, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        """A number in the range; otherwise an error with the reason."""
        number = core_schema.float_schema(ge=self.low, le=self.high, allow_inf_nan=False)
        return core_schema.no_info_wrap_validator_function(self._judged, number)

    def _judged(self, value: Any, is_number: ValidatorFunctionWrapHandler) -> Any:
        try:
            return is_number(value)
        except ValidationError as error:
            if not isinstance(value, int | float) or isinstance(value, bool):
                raise
            said = f"must be {self.low:g} to {self.high:g} ({self.why})"
            raise PydanticCustomError("out_of_range", said) from error


class Kinds(Mapping[str, type[BaseModel]]):
    """Sections by their `kind`, as metadata of a field that takes any of them; each is looked up
    when it is named.

    They are compared by identity, since comparing contents would look up all of them.
    """

    def __eq__(self, other: object) -> bool:
        """Whether it is the same."""
        return self is other

    def __hash__(self) -> int:
        return id(self)


def config_dirs() -> list[Path]:
    """Folders searched for `rigs/`, `models/`, `textures/`: `HAPTIC_CONFIGS`, `./configs`, the
    program's own.

    The program's own lie inside the package where it was installed from a wheel, else beside it.
    """
    named = os.environ.get("HAPTIC_CONFIGS")
    package = Path(__file__).resolve().parent
    installed = package / "configs"
    own = installed if installed.is_dir() else package.parent / "configs"
    return [*([Path(named)] if named else []), Path("configs"), own]


def texture_dirs() -> list[Path]:
    """Folders searched for textures by name."""
    return [folder / "textures" for folder in config_dirs()]


def find_config(name_or_path: str, kind: str) -> Path:
    """The file of that name in a folder `kind` (rigs, models, ...) of the config folders, or the
    path itself.
    """
    given, what = Path(name_or_path), kind[:-1]
    names = config_names(kind)
    if given.suffix == ".toml" or os.sep in name_or_path:
        if os.path.isfile(given):
            return given
        said = "is a folder, not a file" if os.path.isdir(given) else "there is no such file"
        hint = f"Give the path of a file, or the name of a {what}. {nearest(given.stem, names)}"
        raise BadInputError("file_not_found", f"{name_or_path}: {said}", hint)
    for folder in config_dirs():
        path = folder / kind / f"{name_or_path}.toml"
        if os.path.isfile(path):  # False too for a name that no file system takes
            return path
    own = ""
    if os.path.isfile(given):
        own = f"The name of a {what} file of your own must end in .toml. "
    elif os.path.isfile(beside := f"{name_or_path}.toml"):
        own = f"For the file {beside} of this folder, give {beside}. "
    hint = own + nearest(name_or_path, names)
    raise BadInputError(f"unknown_{what}", f"there is no {what} named '{name_or_path}'", hint)


def config_names(kind: str) -> list[str]:
    """The names that `find_config` knows in folders `kind`, sorted; those that would not show as
    they are stay out.
    """
    files = [path for folder in config_dirs() for path in (folder / kind).glob("*.toml")]
    found = {path.stem for path in files if path.is_file()}
    return sorted(filter(str.isprintable, found))


def parse(schema: type[Parsed], content: dict[str, Any], where: str, code: str = "") -> Parsed:
    """`content` as `schema`; BadInputError, with `code` if that is given, names the file and every
    key at fault.
    """
    try:
        return schema.model_validate(content)
    except ValidationError as error:
        faults = sorted(error.errors(), key=_order)
        file: Any = (
            _annotated(schema.model_fields["root"]) if issubclass(schema, RootModel) else schema
        )
        problems = list(dict.fromkeys(problem(fault, file) for fault in faults))
        code = code or ("unknown_key" if faults[0]["type"] == "extra_forbidden" else "bad_config")
        raise BadInputError(code, f"{where}: {'; '.join(problems)}", _hint(file, faults)) from error


def problem(fault: Any, file: Any = None) -> str:
    """What pydantic found wrong, in words, with the key as it is written in a `file`."""
    key = ".".join(_written(file, fault["loc"]))
    said = fault["msg"].removeprefix("Value error, ")
    match fault["type"]:
        case "extra_forbidden":
            return f"unknown key '{key}'" if key else 'a key has no name ("")'
        case "missing":
            return f"{key} is missing"
        case "union_tag_not_found":
            return f"{key}.{_told_apart_by(fault)} is missing".lstrip(".")
        case "union_tag_invalid":
            return f"{key}.{_told_apart_by(fault)} is {fault['ctx']['tag']!r}".lstrip(".")
        case "value_error":
            return f"{key}: {said}" if key else said
    if fault["type"] == "date_type" and isinstance(fault["input"], str):
        said = "a date stands without quotes, such as 2026-01-31"
    if fault["type"] == "string_pattern_mismatch":
        said = PATTERNS[fault["ctx"]["pattern"]]
    value = repr(fault["input"])
    return f"{key or 'the file'}: {said}, not {value if len(value) <= 60 else value[:57] + '...'}"


def _told_apart_by(fault: Any) -> str:
    """The key whose value says which section of a union stands there."""
    return str(fault["ctx"]["discriminator"]).strip("'")


def foremost(faults: Iterable[Any], file: Any = None) -> tuple[Any, str, str]:
    """The fault that explains others, the same in words, and what to do about it."""
    first = sorted(faults, key=_order)[0]
    return first, problem(first, file), _hint(file, [first])


def _order(fault: Any) -> int:
    return FIRST_SAID.get(fault["type"], 2)


def _hint(file: Any, faults: list[Any]) -> str:
    """What to do about the first of them, and about those of its kind that are slips of the pen."""
    kind, loc = faults[0]["type"], faults[0]["loc"]
    if kind == "extra_forbidden":
        unknown = [fault["loc"] for fault in faults if fault["type"] == kind]
        asked = [(str(place[-1]), _fields_at(file, place[:-1])) for place in unknown]
        return "".join(starmap(did_you_mean, asked[:-1])) + nearest(*asked[-1])
    if kind == "union_tag_invalid":
        known = [tag.strip(" '") for tag in faults[0]["ctx"]["expected_tags"].split(",")]
        return nearest(str(faults[0]["ctx"]["tag"]), known)
    if kind in ("missing", "union_tag_not_found"):
        return "Add it"
    key = ".".join(_written(file, loc))
    if key:
        return f"Correct key '{key}'"
    # what is wrong is no single key, but how several of them go together
    known = _fields_at(file, loc)
    return (
        f"Change a key that it names; the keys are: {', '.join(known)}"
        if known
        else "Change what it names"
    )


def _written(file: Any, loc: Sequence[str | int]) -> list[str]:
    """A place in the file as its writer sees it: without the names of variants that pydantic puts
    in between.
    """
    return [
        str(key) for i, key in enumerate(loc) if key not in _variants(_annotation(file, loc[:i]))
    ]


def _fields_at(file: Any, loc: Sequence[str | int]) -> list[str]:
    """The keys that the section at `loc` knows."""
    section = _annotation(file, loc)
    return (
        list(section.model_fields)
        if isinstance(section, type) and issubclass(section, BaseModel)
        else []
    )


def _annotation(schema: Any, loc: Sequence[str | int]) -> Any:
    """What may stand at `loc`: a section, a union of sections, or anything else."""
    for key in loc:
        if isinstance(key, int):
            schema = schema if _variants(schema) else _item(schema)
            continue
        variants = _variants(schema)
        if isinstance(key, str) and key in variants:
            schema = variants[key]
            continue
        sections = [t for t in members(schema) if isinstance(t, type) and issubclass(t, BaseModel)]
        fields = sections[0].model_fields if len(sections) == 1 else {}
        schema = _annotated(fields[key]) if key in fields else None
    sections = [t for t in members(schema) if isinstance(t, type) and issubclass(t, BaseModel)]
    return sections[0] if len(sections) == 1 and not _variants(schema) else schema


def _item(annotation: Any) -> Any:
    """What may stand in a list."""
    lists = [member for member in members(annotation) if get_origin(member) is list]
    return get_args(lists[0])[0] if len(lists) == 1 else None


def _annotated(field: FieldInfo) -> Any:
    """What may stand at a field, with its metadata."""
    return Annotated[field.annotation, *field.metadata] if field.metadata else field.annotation


def _variants(annotation: Any) -> Mapping[str, Any]:
    """The sections of a union by what tells them apart; none for anything else."""
    variants: dict[str, Any] = {}
    for member in members(annotation):
        if isinstance(member, Kinds):
            return member
        fields = getattr(member, "model_fields", {})
        for name in fields.keys() & TELLING:
            if get_origin(fields[name].annotation) is Literal:
                variants |= dict.fromkeys(get_args(fields[name].annotation), member)
    return variants if len(variants) > 1 else {}


def members(annotation: Any) -> list[Any]:
    """A type, or those of a union, through `Annotated`."""
    inner = get_args(annotation)
    is_union = (
        bool(inner)
        and not isinstance(annotation, type)
        and get_origin(annotation) not in (list, dict, Literal)
    )
    return [member for part in inner for member in members(part)] if is_union else [annotation]
