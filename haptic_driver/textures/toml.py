"""Texture files as text."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from haptic_driver.textures.objects import SceneDescription


def toml_lines(content: Mapping[str, Any]) -> str:
    """Lines of TOML, whose texts, numbers and lists are those of JSON; tables stand inline."""
    return "".join(f"{name} = {_value(value)}\n" for name, value in content.items())


def scene_toml(scene: SceneDescription) -> str:
    """A scene's file. Files and textures that it names by a whole path keep that."""
    head = scene.model_dump(mode="json", exclude={"object", "background"}, exclude_none=True)
    parts = [toml_lines({name: value for name, value in head.items() if value != ""})]
    if ground := scene.background.model_dump(mode="json", exclude_none=True):
        parts[0] += toml_lines({"background": ground})
    for each in scene.object:
        said = each.model_dump(mode="json", exclude_none=True)
        parts.append("[[object]]\n" + toml_lines(said))
    return "\n".join(parts)


def _value(value: Any) -> str:
    if isinstance(value, Mapping):
        inside = ", ".join(f"{name} = {_value(one)}" for name, one in value.items())
        return f"{{ {inside} }}"
    return json.dumps(value, ensure_ascii=False)
