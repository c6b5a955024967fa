"""Scenes in a recording: every change is an event, from which
`haptic_driver.lab.scene_replay` makes the scene of any moment again.

The data of an event `scene` have `number`, of the change, and `changes` as the API takes them.
`part` and `parts` are there where it takes several events. `content` has a hash of each texture and
picture that was read for it. A scene begins, and a recording begins in it, with a change that
clears what was before.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from typing import Any

from haptic_driver.render.scene import materials_of
from haptic_driver.render.texture import Texture
from haptic_driver.textures.objects import Change, Move, SceneDescription
from haptic_driver.textures.scene import Made, Material

MOST_BYTES = 40_000  # of the changes in one event, which a recorder takes as a datagram
MOVE_BYTES = 800  # of a change without a shape, at most: names are long and escaped


def as_changes(scene: SceneDescription) -> list[dict[str, Any]]:
    """The changes that make a scene out of any other."""
    ground = {"do": "background", **_said(scene.background)}
    return [{"do": "clear"}, ground, *({"do": "add", **_said(one)} for one in scene.object)]


def change_said(change: Change) -> dict[str, Any]:
    """A change as the API takes it."""
    if isinstance(change, Move):
        return {"do": "move", "id": change.id, "x_mm": change.x_mm, "y_mm": change.y_mm}
    return {"do": change.do, **_said(change)}


def event_data(
    number: int, changes: Sequence[dict[str, Any]], materials: Mapping[Material, Made]
) -> list[dict[str, Any]]:
    """What the events of one change say, in order."""
    parts: list[list[dict[str, Any]]] = [[]]
    left = MOST_BYTES
    for change in changes:
        size = len(json.dumps(change)) if "shape" in change else MOVE_BYTES
        if size > left and parts[-1]:
            parts.append([])
            left = MOST_BYTES
        parts[-1].append(change)
        left -= size
    content = {said_of(each): content_hash(made.texture) for each, made in materials.items()}
    return [
        {"number": number, "part": k, "parts": len(parts), "changes": part, "content": content}
        for k, part in enumerate(parts, 1)
    ]


def content_hash(texture: Texture) -> str:
    """Of the friction that a texture holds."""
    rows, pool = materials_of([texture])
    return hashlib.sha256(rows.tobytes() + pool.tobytes()).hexdigest()[:16]


def said_of(material: Material) -> str:
    """A material in words: its name, and of a picture its width."""
    name, width_mm = material
    return name if width_mm is None else f"{name}, {width_mm:g} mm"


def _said(record: Any) -> dict[str, Any]:
    """What a record says beyond what is usual."""
    said: dict[str, Any] = record.model_dump(mode="json", exclude_defaults=True)
    if getattr(record, "shape", None) is not None:
        said["shape"] = record.shape.model_dump(mode="json")
    if getattr(record, "fit", None) is not None:
        said["fit"] = record.fit
    return said
