"""Textures and scripts by name or by file."""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from haptic_driver.errors import BadInputError, shown
from haptic_driver.files import LONGEST_NAME_BYTES
from haptic_driver.render.texture import FrictionMap, Placed, Profile, Target, Texture, Uniform
from haptic_driver.textures import description, formulas, hjif, scene, script, sources, spectrum
from haptic_driver.textures.objects import SceneDescription
from model.support.errors import did_you_mean
from model.support.reading import read_toml

MAP_EXAMPLE = """\
kind = "map"
file = "{file}"
cof_black = 0.55
cof_white = 0.70
pitch_mm = 0.25"""
HJIF_EXAMPLE = """\
kind = "hjif"
file = "{file}"
cof_low = 0.55
cof_high = 0.70"""
EXAMPLES = {".png": MAP_EXAMPLE, ".npy": MAP_EXAMPLE, ".hjif": HJIF_EXAMPLE}


class Loaded(NamedTuple):
    """What a name or a file stands for. `path` is the file that says so, `kind` and `description`
    as it says; `drawn` is a scene with its objects. `perceptual_gain`: of one texture, 1 where its
    friction is in true size.
    """

    target: Target
    kind: str
    description: str
    path: Path
    drawn: scene.Drawn | None = None
    perceptual_gain: float = 1.0


def texture_names(search: Sequence[Path]) -> list[str]:
    """The names of all textures in the folders searched, sorted; those that would not show as they
    are stay out.
    """
    return sorted({path.stem for path in _files(search) if path.stem.isprintable()})


def nameless_files(search: Sequence[Path]) -> list[str]:
    """The texture files whose names are left out of `texture_names`, as they are shown."""
    return sorted({shown(str(path)) for path in _files(search) if not path.stem.isprintable()})


def _files(search: Sequence[Path]) -> list[Path]:
    return [path for folder in search for path in folder.glob("*.toml") if path.is_file()]


def script_names(search: Sequence[Path]) -> list[str]:
    """Those of `texture_names` that are timed scripts; files that cannot be read are left out."""
    found = []
    for name in texture_names(search):
        there = (p for folder in search if (p := folder / f"{name}.toml").is_file())
        path = next(there, None)  # None: it has just been removed
        with suppress(BadInputError):
            if path is not None and read_toml(path).get("kind") == "script":
                found.append(name)
    return found


def load_texture(name_or_path: str, search: Sequence[Path]) -> Texture:
    """A texture by its name in the folders searched (the first that has it), or by the path of a
    .toml or .csv file.

    A .csv file is a profile along x. The files that a .toml file names lie relative to it.
    """
    loaded = load(name_or_path, search)
    if isinstance(loaded.target, Texture):
        return loaded.target
    hint = "a script runs by the clock: play it on a daemon, or give one of the textures in it"
    raise BadInputError("not_a_texture", f"{loaded.path} is a timed script, not a texture", hint)


def load(name_or_path: str, search: Sequence[Path]) -> Loaded:
    """A texture or a script; names and paths as of `load_texture`. A .csv file with a column time_s
    is a script.
    """
    return _load(name_or_path, search, in_script=False)


def _load(name_or_path: str, search: Sequence[Path], in_script: bool) -> Loaded:
    """What `load` does; `in_script` refuses a script before it is read, so that scripts in a circle
    end.
    """
    path = Path(name_or_path)
    if any(len(part.encode("utf-8", "surrogatepass")) > LONGEST_NAME_BYTES for part in path.parts):
        raise _unknown(f"{name_or_path[:20]}...", search)
    if len(path.parts) == 1:
        for folder in search:
            described = folder / f"{name_or_path}.toml"
            if described.is_file():
                return _load_toml(described, search, in_script)
    if path.suffix or len(path.parts) > 1:
        return _load_file(path, search, in_script)
    raise _unknown(name_or_path, search)


def _load_file(path: Path, search: Sequence[Path], in_script: bool) -> Loaded:
    suffix = path.suffix.lower()
    if not path.is_file() and suffix in (".toml", ".csv", ""):
        raise BadInputError(
            "file_not_found", f"texture file {path} does not exist", _named_hint(path.stem, search)
        )
    if suffix == ".toml":
        return _load_toml(path, search, in_script)
    if suffix == ".csv":
        if script.is_script(path):
            if in_script:
                raise _nested(path)
            return Loaded(
                script.read(path, lambda name: _step_texture(name, path, search)),
                "script",
                "",
                path,
            )
        return Loaded(Profile(*sources.read_profile(path)), "profile", "", path)
    if suffix == ".hmpg":
        hjif.read(path)  # refuses it
    if suffix in EXAMPLES:
        said = (
            f"{path} alone does not say which"
            f" friction{' and which size' if suffix != '.hjif' else ''} it means"
        )
        hint = (
            "write a .toml file beside it and give that"
            f" instead:\n{EXAMPLES[suffix].format(file=path.name)}"
        )
        raise BadInputError("texture_needs_scale", said, hint)
    said = f"{path} is not a texture file"
    raise BadInputError(
        "bad_texture", said, f"give a .toml or .csv file; {_named_hint(path.stem, search)}"
    )


def _load_toml(path: Path, search: Sequence[Path], in_script: bool) -> Loaded:
    described = description.parse(read_toml(path), path)
    if in_script and isinstance(described, description.ScriptDescription):
        raise _nested(path)
    try:
        if isinstance(described, SceneDescription):
            drawn = _drawn(described, path, search)
            return Loaded(drawn.scene(), described.kind, described.description, path, drawn)
        target = _build(described, path, search)
    except BadInputError as error:
        at_fault = f"{path}: key 'file': " if getattr(described, "file", None) is not None else ""
        raise BadInputError(error.code, f"{at_fault}{error.message}", error.hint) from None
    gain = getattr(described, "perceptual_gain", 1.0)
    return Loaded(target, described.kind, described.description, path, perceptual_gain=gain)


def load_material(material: scene.Material, search: Sequence[Path]) -> Texture:
    """What an object of a scene is made of, or its outline. BadInputError for a script, and for a
    scene in a scene.
    """
    if material.width_mm is not None:
        path = Path(material.name)
        if not path.is_file():
            said = f"picture {path} does not exist"
            raise BadInputError("file_not_found", said, "give the path of a PNG picture")
        return scene.read_outline(path, material.width_mm)
    try:
        loaded = _load(material.name, search, in_script=True)
    except BadInputError as error:
        if error.code != "bad_script":
            raise
        hint = "an object is made of a friction or a texture"
        raise BadInputError(error.code, error.message, hint) from None
    if loaded.drawn is not None:
        said = f"{loaded.path} is a scene itself"
        raise BadInputError("nested_scene", said, "give the objects of that scene")
    assert isinstance(loaded.target, Texture)
    return loaded.target


def _drawn(described: SceneDescription, path: Path, search: Sequence[Path]) -> scene.Drawn:
    """A scene whose files may lie beside its own, which whoever changes it need not know."""
    whole = _from_anywhere(described, path.parent, search)
    return scene.drawn(whole, lambda material: load_material(material, [path.parent, *search]))


def _from_anywhere(
    described: SceneDescription, folder: Path, search: Sequence[Path]
) -> SceneDescription:
    """The scene with whole paths for the files beside it."""

    def whole(said: dict[str, Any]) -> dict[str, Any]:
        shape, name = said.get("shape") or {}, said.get("texture") or ""
        if (folder / shape.get("file", "")).is_file():
            shape["file"] = str((folder / shape["file"]).absolute())
        for beside in (folder / name, folder / f"{name}.toml"):
            if name and folder not in search and beside.suffix and beside.is_file():
                said["texture"] = str(beside.absolute())
        return said

    said = described.model_dump()
    whole(said["background"])
    for each in said["object"]:
        whole(each)
    return SceneDescription.model_validate(said)


def _build(
    described: description.TextureDescription | description.ScriptDescription,
    path: Path,
    search: Sequence[Path],
) -> Target:
    if isinstance(described, description.ScriptDescription):
        return script.build(described, path, lambda name: _step_texture(name, path, search))
    return _build_texture(described, path)


def _build_texture(described: description.TextureDescription, path: Path) -> Texture:
    texture: Texture
    match described:
        case description.UniformDescription():
            texture = Uniform(described.cof)
        case description.GratingDescription():
            texture = formulas.grating(described)
        case description.NoiseDescription():
            pitch_m = described.tile_mm * 1e-3 / described.pixels()
            tile = FrictionMap(
                formulas.noise(described), pitch_m, described.stretch * pitch_m, "tile"
            )
            texture = _placed(tile, [0.0, 0.0], described.rotation_deg)
        case description.SpectrumDescription():
            texture = spectrum.spectrum(described, str(path))
        case description.ProfileDescription():
            position_m, cof = map(np.array, sources.read_profile(path.parent / described.file))
            cof = formulas.amplified(position_m, cof, described.perceptual_gain)
            profile = Profile(position_m.tolist(), cof.tolist(), described.outside)
            texture = _placed(profile, described.origin_mm, described.direction_deg)
        case description.MapDescription():
            picture = _build_map(described, path.parent / described.file)
            texture = _placed(picture, described.origin_mm, described.rotation_deg)
        case description.HjifDescription():
            position_m, amplitude = hjif.read(path.parent / described.file)
            cof = described.cof_low + (described.cof_high - described.cof_low) * amplitude
            curve = Profile(position_m.tolist(), cof.tolist(), described.outside)
            texture = _placed(curve, described.origin_mm, described.direction_deg)
    return texture.of_waves(described.wave_m())


def _step_texture(name: str, script_path: Path, search: Sequence[Path]) -> Texture:
    """A texture named in a script: a file beside it, or a name beside it or in the folders
    searched.
    """
    beside = script_path.parent / name
    if beside.suffix and beside.is_file():
        name = str(beside)
    target = _load(name, [script_path.parent, *search], in_script=True).target
    assert isinstance(target, Texture)
    return target


def _nested(path: Path) -> BadInputError:
    return BadInputError(
        "bad_script", f"{path} is a script itself", "a step of a script is a cof or a texture"
    )


def _placed(texture: Texture, origin_mm: list[float], rotation_deg: float) -> Texture:
    if not any(origin_mm) and rotation_deg == 0.0:
        return texture
    origin_x_m, origin_y_m = (offset_mm * 1e-3 for offset_mm in origin_mm)
    return Placed(texture, origin_x_m, origin_y_m, math.radians(rotation_deg))


def _build_map(described: description.MapDescription, path: Path) -> FrictionMap:
    scale = described.scale()
    if scale is None and path.suffix.lower() == ".png":
        said = (
            f"{path} does not say which friction it means without the keys 'cof_black' and"
            " 'cof_white'"
        )
        raise BadInputError(
            "texture_needs_scale", said, "add for example: cof_black = 0.55, cof_white = 0.70"
        )
    values = sources.read_map(path)
    if scale is None:
        sources.require_cof(path, values)
    else:
        sources.require_shares(path, values)
        black, white = scale
        values = black * (1.0 - values) + white * values
    return FrictionMap(*formulas.averaged(values, *described.pitch_m()), described.outside)


def _unknown(name: str, search: Sequence[Path]) -> BadInputError:
    return BadInputError(
        "unknown_texture", f"there is no texture '{name}'", _named_hint(name, search)
    )


def _named_hint(name: str, search: Sequence[Path]) -> str:
    names = texture_names(search)
    if not names:
        return f"there are no textures in {', '.join(map(str, search)) or 'no folder'}"
    return f"{did_you_mean(name, names)}textures: {', '.join(names)}"
