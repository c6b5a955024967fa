"""What a texture file may say: keys, ranges, and errors that name the key."""

from __future__ import annotations

import difflib
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, TypeAdapter, ValidationError, model_validator

from haptic_driver.errors import BadInputError

LOWEST_COF = 0.01
HIGHEST_COF = 5.0

Cof = Annotated[float, Field(ge=LOWEST_COF, le=HIGHEST_COF, allow_inf_nan=False)]
LengthMm = Annotated[float, Field(ge=0.001, le=10_000.0, allow_inf_nan=False)]
OffsetMm = Annotated[float, Field(ge=-10_000.0, le=10_000.0, allow_inf_nan=False)]
Degrees = Annotated[float, Field(ge=-360.0, le=360.0, allow_inf_nan=False)]


def _both_axes(pitch_mm: object) -> object:
    return pitch_mm if isinstance(pitch_mm, list) else [pitch_mm, pitch_mm]


PitchMm = Annotated[list[LengthMm], BeforeValidator(_both_axes), Field(min_length=2, max_length=2)]
FileName = Annotated[str, Field(min_length=1)]


class _Description(BaseModel):
    # Strict: TOML has types of its own, so the text "0.6" where a number belongs is a mistake.
    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)


class UniformDescription(_Description):
    """The same friction everywhere."""

    kind: Literal["uniform"]
    cof: Cof


class GratingDescription(_Description):
    """Mean friction plus a sine."""

    kind: Literal["grating"]
    mean_cof: Cof
    amplitude_cof: Annotated[float, Field(ge=0.0, le=HIGHEST_COF, allow_inf_nan=False)]
    period_mm: LengthMm
    direction_deg: Degrees = 0.0
    phase_deg: Degrees = 0.0

    @model_validator(mode="after")
    def _stays_in_range(self) -> Self:
        low, high = self.mean_cof - self.amplitude_cof, self.mean_cof + self.amplitude_cof
        if low < LOWEST_COF or high > HIGHEST_COF:
            raise ValueError(
                f"mean_cof and amplitude_cof reach {low:g} to {high:g}, outside {LOWEST_COF} to {HIGHEST_COF}"
            )
        return self


class ProfileDescription(_Description):
    """Points along x, in a CSV file with columns position_m and cof."""

    kind: Literal["profile"]
    file: FileName


class MapDescription(_Description):
    """A picture of friction.

    `pitch_mm` is one number, or one each for x and y. With `cof_black` and `cof_white` the file holds 0 to 1 of full
    scale; without them, an array file holds cof itself.
    """

    kind: Literal["map"]
    file: FileName
    pitch_mm: PitchMm
    cof_black: Cof | None = None
    cof_white: Cof | None = None
    origin_mm: Annotated[list[OffsetMm], Field(min_length=2, max_length=2)] = [0.0, 0.0]
    tile: bool = False

    @model_validator(mode="after")
    def _scale_is_whole(self) -> Self:
        if (self.cof_black is None) != (self.cof_white is None):
            raise ValueError("cof_black and cof_white go together")
        return self

    def scale(self) -> tuple[float, float] | None:
        """Friction of black and of white, or None where the file holds friction itself."""
        if self.cof_black is None or self.cof_white is None:
            return None
        return self.cof_black, self.cof_white

    def pitch_m(self) -> tuple[float, float]:
        """Pitch along x and along y."""
        x_mm, y_mm = self.pitch_mm
        return x_mm * 1e-3, y_mm * 1e-3


Description = UniformDescription | GratingDescription | ProfileDescription | MapDescription

_KINDS: dict[str, type[_Description]] = {
    "uniform": UniformDescription,
    "grating": GratingDescription,
    "profile": ProfileDescription,
    "map": MapDescription,
}
_ADAPTER: TypeAdapter[Description] = TypeAdapter(Annotated[Description, Field(discriminator="kind")])


def parse(content: dict[str, Any], path: Path) -> Description:
    """The description in a texture file's content; `path` is for the error, which names every key at fault."""
    try:
        return _ADAPTER.validate_python(content)
    except ValidationError as error:
        faults = error.errors()
        problems = list(dict.fromkeys(_problem(fault) for fault in faults))
        raise BadInputError("bad_texture", f"{path}: {'; '.join(problems)}", _hint(faults, content)) from None


def _problem(fault: Any) -> str:
    key = ".".join(str(part) for part in fault["loc"][1:2])  # after the kind; what follows is pydantic's own
    if fault["type"] == "union_tag_not_found":
        return "key 'kind' is missing"
    if fault["type"] == "union_tag_invalid":
        return f"kind = {fault['ctx']['tag']!r} is unknown"
    if fault["type"] == "extra_forbidden":
        return f"unknown key '{key}'"
    if fault["type"] == "missing":
        return f"key '{key}' is missing"
    if not key:
        return str(fault["msg"]).removeprefix("Value error, ")
    value = repr(fault["input"])
    return f"key '{key}': {fault['msg']}, got {value if len(value) <= 60 else value[:57] + '...'}"


def _hint(faults: list[Any], content: dict[str, Any]) -> str:
    kind = content.get("kind")
    if not isinstance(kind, str) or kind not in _KINDS:
        return f"{nearest(str(kind), list(_KINDS))}kind is one of: {', '.join(_KINDS)}"
    keys = list(_KINDS[kind].model_fields)
    unknown = [str(fault["loc"][1]) for fault in faults if fault["type"] == "extra_forbidden"]
    return f"{''.join(nearest(key, keys) for key in unknown)}keys of a {kind}: {', '.join(keys)}"


def nearest(word: str, known: list[str]) -> str:
    """The words "did you mean ...? ", or nothing where no known word is like it."""
    matches = difflib.get_close_matches(word, known, n=1)
    return f"did you mean '{matches[0]}'? " if matches else ""
