"""A scene's file as text."""

from __future__ import annotations

from haptic_driver.textures.objects import SceneDescription
from model.support.toml import toml_lines


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
