"""Scenes from what is said of them: objects and what they are made of -> rows that render looks up.

Textures and outlines of pictures are read once, by the caller that draws a scene. A move, a turn or
a change of order afterwards makes new rows for the same materials.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from copy import copy
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from haptic_driver.errors import BadInputError
from haptic_driver.render.scene import (
    FINEST_EDGE_M,
    OBJECT_COLUMNS,
    ObjectRow,
    Objects,
    Outline,
    Scene,
    materials_of,
)
from haptic_driver.render.texture import FrictionMap, Outside, Placed, Profile, Texture
from haptic_driver.textures.objects import (
    Background,
    Change,
    Circle,
    Ellipse,
    Mask,
    Move,
    Polygon,
    Rectangle,
    SceneDescription,
    SceneObject,
    Turn,
)
from haptic_driver.textures.sources import read_mask

ROUNDING = 1.0 + 1e-9  # of a place on the outline
PLACE, TURN = slice(1, 3), slice(3, 5)  # columns of `ObjectRow`
REACH = ObjectRow._fields.index("reach_m")


class Material(NamedTuple):
    """What has to be read for an object: a texture, or the outline of a picture `width_mm` wide."""

    name: str
    width_mm: float | None = None


class Made(NamedTuple):
    """What was read, its lowest and highest friction, and its finest detail: of a whole map they
    take a while.
    """

    texture: Texture
    low: float
    high: float
    detail_m: float

    @classmethod
    def of(cls, texture: Texture) -> Made:
        return cls(texture, *texture.bounds(), texture.detail_m)


class Laid(NamedTuple):
    """A material as an object has it: `scale` times as large, tiled or not, its point 0, 0 at x_m,
    y_m from the object's place. With the texture's own place where `scale` is 0.
    """

    material: Material
    scale: float = 0.0
    x_m: float = 0.0
    y_m: float = 0.0
    tiled: bool = False

    def of(self, texture: Texture) -> Texture:
        """The texture so."""
        own = _bare(texture)
        if self.scale == 0.0 or not isinstance(own, FrictionMap | Profile):
            return texture
        outside: Outside = "tile" if self.tiled else own.outside
        if isinstance(own, FrictionMap):
            x_m, y_m = self.scale * own.pitch_x_m, self.scale * own.pitch_y_m
            laid = replace(own, pitch_x_m=x_m, pitch_y_m=y_m, outside=outside)
            return Placed(laid, self.x_m, self.y_m)
        positions = [self.scale * x_m for x_m in own.position_m]
        return Placed(Profile(positions, own.cof, outside), self.x_m, self.y_m)


class Drawn(NamedTuple):
    """A scene as it is said, the materials that were read for it, and how they are laid, each in
    its order.
    """

    described: SceneDescription
    materials: Mapping[Material, Made]
    laid: tuple[Laid, ...] = ()

    @property
    def missing(self) -> list[Material]:
        """What its objects need and nobody has read yet."""
        wanted = dict.fromkeys(m for each in self.all for m in _materials(each))
        return [material for material in wanted if material not in self.materials]

    def changed(self, described: SceneDescription) -> Drawn:
        return self._replace(described=described)

    def with_material(self, material: Material, made: Made) -> Drawn:
        return self._replace(materials={**self.materials, material: made})

    def without_leftovers(self) -> Drawn:
        """Without what none of its objects needs any more."""
        wanted = Drawn(self.described, {}).missing
        kept = {each: self.materials[each] for each in wanted}
        return self._replace(materials=kept, laid=()).arranged()

    def arranged(self) -> Drawn:
        """With its materials as its objects have them, besides how they were laid before."""
        now = [laid for each in self.all for laid in _laid(each, self.materials)]
        return self._replace(laid=tuple(dict.fromkeys([*self.laid, *now])))

    def scene(self) -> Scene:
        """All of it, as render takes it."""
        textures = [laid.of(self.materials[laid.material].texture) for laid in self.laid]
        return Scene(self.objects(), materials_of(textures))

    def objects(self) -> Objects:
        """The rows of what is enabled, the lowest first, with the corners of polygons."""
        numbers = {laid: k for k, laid in enumerate(self.laid)}
        corners: list[list[float]] = []
        ground = _background_row(self, numbers)
        rows = [] if ground is None else [ground]
        for each in self.shown():
            row = _row(each, self.materials, numbers, len(corners))
            rows.append(row)
            if isinstance(each.shape, Polygon):
                corners += each.shape.corners_mm
        table = np.array(rows, float).reshape(len(rows), OBJECT_COLUMNS)
        return Objects(table, 1e-3 * np.array(corners, float).reshape(len(corners), 2))

    def shown(self) -> list[SceneObject]:
        """What is enabled, the lowest first."""
        there = [each for each in self.described.object if each.enabled]
        return sorted(there, key=lambda each: each.order)

    @property
    def all(self) -> list[SceneObject | Background]:
        return [self.described.background, *self.described.object]


def drawn(described: SceneDescription, read: Callable[[Material], Texture]) -> Drawn:
    """A scene with all that its objects need; `read` finds it. BadInputError names the object."""
    scene = Drawn(described, {})
    for each in scene.all:
        for material in _materials(each):
            if material in scene.materials:
                continue
            try:
                scene = scene.with_material(material, Made.of(read(material)))
            except BadInputError as error:
                who = f"object '{each.id}'" if isinstance(each, SceneObject) else "background"
                raise BadInputError(error.code, f"{who}: {error.message}", error.hint) from None
    return scene.arranged()


class Live:
    """A scene that is changed many times a second. Moves and turns change its rows alone; its
    description is written on request.
    """

    def __init__(self, drawn: Drawn) -> None:
        self._drawn = drawn
        self._said: dict[str, dict[str, Any]] = {}  # of objects that have moved or turned since
        self.objects = drawn.objects()
        ids = [each.id for each in drawn.shown()]
        first = self.objects.rows.shape[0] - len(ids)  # the background lies below
        self._rows = {name: first + k for k, name in enumerate(ids)}

    @property
    def count(self) -> int:
        """How many objects it has."""
        return len(self._drawn.described.object)

    @property
    def drawn(self) -> Drawn:
        """It as it is now."""
        if not self._said:
            return self._drawn
        described = self._drawn.described
        objects = [
            each.model_copy(update=self._said[each.id]) if each.id in self._said else each
            for each in described.object
        ]
        return self._drawn.changed(described.model_copy(update={"object": objects}))

    def moved(self, changes: Sequence[Change], screen_m: tuple[float, float]) -> Live | None:
        """The scene after such changes; None where they are more than moves and turns of what is
        there. BadInputError for an object that leaves the screen.
        """
        said, moved, turned = dict(self._said), dict[int, list[float]](), dict[int, float]()
        for change in changes:
            if not isinstance(change, Move | Turn) or change.id not in self._rows:
                return None
            at = self._rows[change.id]
            if isinstance(change, Move):
                moved[at] = [change.x_mm, change.y_mm]
                new: dict[str, Any] = {"origin_mm": moved[at]}
            else:
                turned[at] = change.rotation_deg
                new = {"rotation_deg": turned[at]}
            said[change.id] = said.get(change.id, {}) | new
        rows, turns_rad = self.objects.rows.copy(), np.radians([*turned.values()])
        places = 1e-3 * np.array([*moved.values()], float).reshape(-1, 2)
        rows[[*moved], PLACE] = places
        rows[[*turned], TURN] = np.column_stack([np.cos(turns_rad), np.sin(turns_rad)])
        live = copy(self)
        live.objects, live._said = Objects(rows, self.objects.points), said
        reach_m = rows[[*moved], REACH]
        beyond_m = np.maximum(np.maximum(-places, places - np.array(screen_m)), 0.0)
        if (np.hypot(*beyond_m.T) > reach_m).any():
            drawn = live.drawn
            for each in drawn.described.object:
                require_on_screen(each, drawn, screen_m)
        return live


def read_outline(path: Path, width_mm: float) -> FrictionMap:
    """The distance outside of what a picture shows, as a map whose corner lies at 0, 0."""
    outside = read_mask(path)
    pitch_m = 1e-3 * width_mm / outside.shape[1]
    return FrictionMap(pitch_m * outside, pitch_m, pitch_m, "clamp")


def require_on_screen(each: SceneObject, drawn: Drawn, screen_m: tuple[float, float]) -> None:
    """Refuse an object no part of which can lie on a screen as large."""
    row = _row(each, drawn.materials, dict.fromkeys(_laid(each, drawn.materials), 0), 0)
    beyond = [max(-p, p - s, 0.0) for p, s in zip((row.x_m, row.y_m), screen_m, strict=True)]
    if math.hypot(*beyond) <= row.reach_m:
        return
    x_mm, y_mm = each.origin_mm
    w_mm, h_mm = (1e3 * side for side in screen_m)
    said = f"object '{each.id}' at {x_mm:g}, {y_mm:g} mm lies off the screen"
    hint = f"the screen is {w_mm:g} by {h_mm:g} mm; to hide an object set enabled to false"
    raise BadInputError("off_screen", said, hint)


def _materials(each: SceneObject | Background) -> list[Material]:
    found = [] if each.texture is None else [Material(each.texture)]
    if isinstance(each, SceneObject) and isinstance(each.shape, Mask):
        found.append(Material(each.shape.file, each.shape.width_mm))
    return found


def _background_row(drawn: Drawn, numbers: Mapping[Laid, int]) -> ObjectRow | None:
    ground = drawn.described.background
    if ground.cof is None and ground.texture is None:
        return None
    place = (0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    return ObjectRow(
        Outline.EVERYWHERE, *place, math.inf, 0.0, *_fill(ground, drawn.materials, numbers)
    )


def _row(
    each: SceneObject, materials: Mapping[Material, Made], numbers: Mapping[Laid, int], corner: int
) -> ObjectRow:
    """An object whose corners, if it has any, begin at that number."""
    outline, half_x_m, half_y_m, radius_m, reach_m, first, count = _outline(
        each, materials, numbers, corner
    )
    edge_m, turned_rad = 1e-3 * each.soft_edge_mm, math.radians(each.rotation_deg)
    material, cof, low, high, detail_m = _fill(each, materials, numbers)
    return ObjectRow(
        outline,
        1e-3 * each.origin_mm[0],
        1e-3 * each.origin_mm[1],
        math.cos(turned_rad),
        math.sin(turned_rad),
        half_x_m,
        half_y_m,
        radius_m,
        first,
        count,
        ROUNDING * reach_m + 0.5 * edge_m,
        edge_m,
        material,
        cof,
        low,
        high,
        min(detail_m, max(edge_m, FINEST_EDGE_M)),
    )


def _outline(
    each: SceneObject, materials: Mapping[Material, Made], numbers: Mapping[Laid, int], corner: int
) -> tuple[Outline, float, float, float, float, float, float]:
    """Kind, half of its size along x and y, radius of corners, reach, first corner, count."""
    match each.shape:
        case Rectangle() as shape:
            half_m = 0.5e-3 * shape.width_mm, 0.5e-3 * shape.height_mm
            reach_m = math.hypot(*half_m)
            return Outline.RECTANGLE, *half_m, 1e-3 * shape.radius_mm, reach_m, 0, 0
        case Circle() as shape:
            radius_m = 1e-3 * shape.radius_mm
            return Outline.ELLIPSE, radius_m, radius_m, 0.0, radius_m, 0, 0
        case Ellipse() as shape:
            half_m = 0.5e-3 * shape.width_mm, 0.5e-3 * shape.height_mm
            return Outline.ELLIPSE, *half_m, 0.0, max(half_m), 0, 0
        case Polygon() as shape:
            reach_m = 1e-3 * max(math.hypot(x, y) for x, y in shape.corners_mm)
            return Outline.POLYGON, 0.0, 0.0, 0.0, reach_m, corner, len(shape.corners_mm)
        case Mask() as shape:
            key = Material(shape.file, shape.width_mm)
            width_m, height_m = _size(materials[key].texture)
            half_m = 0.5 * width_m, 0.5 * height_m
            return Outline.MASK, *half_m, 0.0, math.hypot(*half_m), numbers[Laid(key)], 0


def _fill(
    each: SceneObject | Background, materials: Mapping[Material, Made], numbers: Mapping[Laid, int]
) -> tuple[float, float, float, float, float]:
    """Material, friction, the lowest and the highest, and the finest detail."""
    if each.texture is None:
        cof = math.nan if each.cof is None else each.cof
        return -1.0, cof, cof, cof, math.inf
    made, (laid, *_) = materials[Material(each.texture)], _laid(each, materials)
    detail_m = (laid.scale or 1.0) * made.detail_m
    return float(numbers[laid]), math.nan, made.low, made.high, detail_m


def _laid(each: SceneObject | Background, materials: Mapping[Material, Made]) -> list[Laid]:
    """The texture of an object as it has it, and the outline of its picture."""
    found = [Laid(material) for material in _materials(each)]
    if each.texture is None or not isinstance(each, SceneObject) or each.fit == "place":
        return found
    own = _bare(materials[Material(each.texture)].texture)
    if not isinstance(own, FrictionMap | Profile) or own.outside != "nothing":
        return found  # it ends nowhere
    left_m, top_m, width_m, height_m = _box(each, materials)
    if isinstance(own, Profile):
        begins_m, long_m, high_m = own.position_m[0], own.position_m[-1] - own.position_m[0], 0.0
    else:
        begins_m, (long_m, high_m) = 0.0, _size(own)
    if each.fit == "tile":
        found[0] = Laid(found[0].material, 1.0, left_m - begins_m, top_m, tiled=True)
        return found
    scale = max(width_m / long_m, height_m / high_m if high_m else 0.0)
    x_m = left_m + 0.5 * (width_m - scale * long_m) - scale * begins_m
    found[0] = Laid(found[0].material, scale, x_m, top_m + 0.5 * (height_m - scale * high_m))
    return found


def _bare(texture: Texture) -> Texture:
    """A texture without the place that its file gives it on the screen."""
    while isinstance(texture, Placed):
        texture = texture.texture
    return texture


def _size(picture: Texture) -> tuple[float, float]:
    """Width and height of a map."""
    assert isinstance(picture, FrictionMap)
    rows, columns = picture.cof.shape
    return columns * picture.pitch_x_m, rows * picture.pitch_y_m


def _box(
    each: SceneObject, materials: Mapping[Material, Made]
) -> tuple[float, float, float, float]:
    """Around an object's outline, in its own axes: left, top, width and height, m."""
    match each.shape:
        case Circle() as shape:
            width_m = height_m = 2e-3 * shape.radius_mm
        case Polygon() as shape:
            corners = 1e-3 * np.array(shape.corners_mm)
            (left_m, top_m), (right_m, low_m) = corners.min(axis=0), corners.max(axis=0)
            return float(left_m), float(top_m), float(right_m - left_m), float(low_m - top_m)
        case Mask() as shape:
            width_m, height_m = _size(materials[Material(shape.file, shape.width_mm)].texture)
        case shape:
            width_m, height_m = 1e-3 * shape.width_mm, 1e-3 * shape.height_mm
    return -0.5 * width_m, -0.5 * height_m, width_m, height_m
