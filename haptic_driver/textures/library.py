"""Textures by name or by file."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Sequence
from pathlib import Path

from haptic_driver.errors import BadInputError
from haptic_driver.render.texture import FrictionMap, Grating, Profile, Texture, Uniform
from haptic_driver.textures import description, files
from haptic_driver.textures.description import nearest

NEEDS_SCALE = (".png", ".npy")
EXAMPLE = """\
kind = "map"
file = "{file}"
cof_black = 0.55
cof_white = 0.70
pitch_mm = 0.25"""


def texture_names(search: Sequence[Path]) -> list[str]:
    """The names of all textures in the folders searched, sorted."""
    return sorted({path.stem for folder in search if folder.is_dir() for path in folder.glob("*.toml")})


def load_texture(name_or_path: str, search: Sequence[Path]) -> Texture:
    """A texture by its name in the folders searched (the first that has it), or by the path of a .toml or .csv file.

    A .csv file is a profile along x. The files that a .toml file names lie relative to it.
    """
    path = Path(name_or_path)
    if len(path.parts) == 1:
        for folder in search:
            described = folder / f"{name_or_path}.toml"
            if described.is_file():
                return _load_toml(described)
    if path.suffix or len(path.parts) > 1:
        return _load_file(path, search)
    raise _unknown(name_or_path, search)


def _load_file(path: Path, search: Sequence[Path]) -> Texture:
    suffix = path.suffix.lower()
    if not path.is_file() and suffix in (".toml", ".csv", ""):
        raise BadInputError("file_not_found", f"texture file {path} does not exist", _named_hint(path.stem, search))
    if suffix == ".toml":
        return _load_toml(path)
    if suffix == ".csv":
        return Profile(*files.read_profile(path))
    if suffix in NEEDS_SCALE:
        raise BadInputError(
            "texture_needs_scale",
            f"{path} alone does not say which friction and which size it means",
            f"write a .toml file beside it and give that instead:\n{EXAMPLE.format(file=path.name)}",
        )
    raise BadInputError(
        "bad_texture", f"{path} is not a texture file", f"give a .toml or .csv file; {_named_hint(path.stem, search)}"
    )


def _load_toml(path: Path) -> Texture:
    try:
        content = tomllib.loads(files.read_text(path))
    except (ValueError, RecursionError) as error:  # ValueError: also a number of thousands of digits
        raise BadInputError("bad_texture", f"{path} is not TOML: {error}", "write lines such as: cof = 0.60") from None
    described = description.parse(content, path)
    try:
        return _build(described, path.parent)
    except BadInputError as error:
        raise BadInputError(error.code, f"{path}: key 'file': {error.message}", error.hint) from None


def _build(described: description.Description, folder: Path) -> Texture:
    match described:
        case description.UniformDescription():
            return Uniform(described.cof)
        case description.GratingDescription():
            return Grating(
                described.mean_cof,
                described.amplitude_cof,
                described.period_mm * 1e-3,
                math.radians(described.direction_deg),
                math.radians(described.phase_deg),
            )
        case description.ProfileDescription():
            return Profile(*files.read_profile(folder / described.file))
        case description.MapDescription():
            return _build_map(described, folder / described.file)


def _build_map(described: description.MapDescription, path: Path) -> FrictionMap:
    scale = described.scale()
    if scale is None and path.suffix.lower() == ".png":
        raise BadInputError(
            "texture_needs_scale",
            f"{path} does not say which friction it means without the keys 'cof_black' and 'cof_white'",
            "add for example: cof_black = 0.55, cof_white = 0.70",
        )
    values = files.read_map(path)
    if scale is None:
        files.require_cof(path, values)
    else:
        files.require_shares(path, values)
        black, white = scale
        values = black * (1.0 - values) + white * values
    pitch_x_m, pitch_y_m = described.pitch_m()
    origin_x_m, origin_y_m = (offset_mm * 1e-3 for offset_mm in described.origin_mm)
    return FrictionMap(values, pitch_x_m, pitch_y_m, origin_x_m, origin_y_m, described.tile)


def _unknown(name: str, search: Sequence[Path]) -> BadInputError:
    return BadInputError("unknown_texture", f"there is no texture '{name}'", _named_hint(name, search))


def _named_hint(name: str, search: Sequence[Path]) -> str:
    names = texture_names(search)
    if not names:
        return f"there are no textures in {', '.join(map(str, search)) or 'no folder'}"
    return f"{nearest(name, names)}textures: {', '.join(names)}"
