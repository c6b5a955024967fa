"""Scenes of a recording made again from its events, which `recording.scenes` describes."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from pydantic import TypeAdapter

from haptic_driver.config import texture_dirs
from haptic_driver.errors import BadInputError
from haptic_driver.recording.event import Event
from haptic_driver.recording.read import Run
from haptic_driver.recording.scenes import content_hash, said_of
from haptic_driver.render.scene import Scene
from haptic_driver.signals import Array
from haptic_driver.textures.library import load_material
from haptic_driver.textures.objects import Change, SceneDescription
from haptic_driver.textures.scene import Drawn, Made, Material
from model.support.toml import toml_lines

_CHANGES: TypeAdapter[list[Change]] = TypeAdapter(list[Change])


class Moment(NamedTuple):
    """From `time_s` on there is this scene, or no scene."""

    time_s: float
    scene: SceneDescription | None


class SceneReplay:
    """The scenes of a run, from its events; textures and pictures are read as they are now.

    `differing`: those of them that are not what they were.
    """

    def __init__(self, run: Run) -> None:
        """BadInputError where there is no scene, and for what cannot be read any more."""
        self.run = run
        self.moments = list(_moments(run.events))
        scenes = [moment.scene for moment in self.moments if moment.scene is not None]
        if not scenes:
            said = f"{run.name} has no scene"
            raise BadInputError("no_scene", said, "record while a scene is rendered")
        then: dict[str, str] = {}
        for event in run.events:
            if event.kind == "scene":
                then |= event.data["content"]
        made: dict[Material, Made] = {}
        for material in dict.fromkeys(m for scene in scenes for m in Drawn(scene, {}).missing):
            made[material] = Made.of(load_material(material, texture_dirs()))
        self.differing = [
            said_of(material)
            for material, one in made.items()
            if content_hash(one.texture) != then.get(said_of(material))
        ]
        drawn = Drawn(scenes[0], made)
        for scene in scenes:
            drawn = drawn.changed(scene).arranged()
        self._drawn, self._scene = drawn, drawn.scene()

    def described_at(self, time_s: float) -> SceneDescription | None:
        """The scene of a moment on the run's clock; None where there was none."""
        known = [moment.time_s for moment in self.moments]
        index = bisect_right(known, time_s) - 1
        return self.moments[index].scene if index >= 0 else None

    def scene_at(self, time_s: float) -> Scene | None:
        """The same as a texture, which can be asked for friction."""
        described = self.described_at(time_s)
        return None if described is None else self._as_it_was(described)

    def asked_cof(self) -> Array:
        """Friction that the scenes ask for at each tick, where the finger was to be when its output
        acts; NaN without contact or scene.
        """
        samples = self.run.samples
        began_s = samples["time_s"] + samples["lateness_s"]
        starts = np.searchsorted(began_s, [m.time_s for m in self.moments]).tolist()
        cof = np.full(samples.size, np.nan)
        for moment, start, end in zip(
            self.moments, starts, [*starts[1:], samples.size], strict=True
        ):
            if moment.scene is None or end <= start:
                continue
            part = samples[start:end]
            x_m, y_m = (np.array(part[f"output_{axis}_m"], float) for axis in "xy")
            felt = self._as_it_was(moment.scene).cof_at(x_m, y_m)
            cof[start:end] = np.where(part["in_contact"] == 1, felt, np.nan)
        return cof

    def _as_it_was(self, described: SceneDescription) -> Scene:
        return self._scene.with_objects(self._drawn.changed(described).objects())


def _moments(events: Sequence[Event]) -> Iterator[Moment]:
    scene: SceneDescription | None = None
    waiting: list[dict[str, Any]] = []
    for event in events:
        if event.kind == "scene":
            # before objects had a fit, a texture's point 0, 0 lay at their place
            changes = event.data["changes"]
            waiting += [{"fit": "place", **c} if c["do"] == "add" else c for c in changes]
            if event.data["part"] < event.data["parts"]:
                continue
            changes, waiting = _CHANGES.validate_python(waiting), []
            scene = (scene or SceneDescription()).changed(changes)
            yield Moment(event.time_s, scene)
        elif event.kind in ("target", "texture") and scene is not None:
            scene = None
            yield Moment(event.time_s, None)


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
