"""Scenes: objects that lie on one another, each with a friction or a texture that moves with it."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from enum import IntEnum
from functools import cache
from importlib import import_module
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np

from haptic_driver.errors import BadInputError
from haptic_driver.render.texture import (
    FloatArray,
    FrictionMap,
    Grating,
    Outside,
    Placed,
    Profile,
    Texture,
    Uniform,
    Waves,
)
from haptic_driver.signals import FingerState

# As wide is a step that the output makes at once: no texture's edge is finer.
FINEST_EDGE_M = 1e-4
ANYHOW = (math.nan, math.nan)  # speed and load where no finger says its own


class Outline(IntEnum):
    """Kinds of outlines."""

    EVERYWHERE = 0
    RECTANGLE = 1
    ELLIPSE = 2
    POLYGON = 3
    MASK = 4


class ObjectRow(NamedTuple):
    """An object: its place and how it is turned, its outline, and what it is made of.

    `half_x_m`, `half_y_m`: half of its size along its own x and y. `first`: of its corners among
    all points, `corners` of them; of a mask the number of its material, which is distance outside.
    `reach_m`: how far it reaches from its place, edge included. `material`: -1 for the friction
    `cof`. Then its lowest and highest friction, and the finest detail of it.
    """

    outline: float
    x_m: float
    y_m: float
    cos: float
    sin: float
    half_x_m: float
    half_y_m: float
    radius_m: float
    first: float
    corners: float
    reach_m: float
    edge_m: float
    material: float
    cof: float
    low: float
    high: float
    detail_m: float


OBJECT_COLUMNS = len(ObjectRow._fields)
# Kind, place, cosine and sine of its turn, start in the pool, three sizes of tables, five numbers.
MATERIAL_COLUMNS = 14
LOW, HIGH, DETAIL = (ObjectRow._fields.index(name) for name in ("low", "high", "detail_m"))
KINDS = (Uniform, Grating, Profile, Waves, FrictionMap)


class Objects(NamedTuple):
    """Rows [n, OBJECT_COLUMNS], the lowest object first, and the corners [n, 2] of all polygons.

    The numbers of materials in them are those of one scene.
    """

    rows: FloatArray
    points: FloatArray


class Materials(NamedTuple):
    """Rows [n, MATERIAL_COLUMNS], and their tables."""

    rows: FloatArray
    pool: FloatArray


@dataclass(frozen=True, eq=False)
class Scene(Texture):
    """Objects on one another; nothing is asked for where there is none.

    `with_objects` gives the same materials to another table of objects, which is what moves them.
    `met`: speed and load of the finger, where one is known.
    """

    objects: Objects
    materials: Materials
    met: tuple[float, float] = ANYHOW
    _bounds: tuple[float, float] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        """Keep what is asked of all objects together."""
        rows, ends = self.objects.rows, (math.nan, math.nan)
        if rows.size:
            ends = float(rows[:, LOW].min()), float(rows[:, HIGH].max())
        object.__setattr__(self, "_bounds", ends)
        self._lock()

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Compiled functions take arrays that nobody can change for another type."""
        self.__dict__.update(state)
        self._lock()

    def _lock(self) -> None:
        for array in (*self.objects, *self.materials):
            array.setflags(write=False)

    def with_objects(self, objects: Objects) -> Scene:
        return replace(self, objects=objects)

    def under(self, speed_m_s: float, normal_force_n: float) -> Texture:
        """With another usual speed and load."""
        return replace(self, met=(speed_m_s, normal_force_n))

    def cof_under(self, finger: FingerState) -> float:
        """Friction at the finger's position, at its speed and load."""
        place = finger.position_x_m, finger.position_y_m
        cof: float = _lookup().scene_at(*self._tables, _met_by(finger), *place)
        return cof

    def cof_along(self, finger: FingerState, ahead_s: FloatArray) -> FloatArray:
        """Friction where the finger will be, at its speed and load."""
        places = _lookup().places_ahead(finger[1:5], ahead_s)
        cof: FloatArray = _lookup().scene_at_points(*self._tables, _met_by(finger), *places)
        return cof

    def bounds(self) -> tuple[float, float]:
        """The lowest and the highest of all objects; NaN where there are none."""
        return self._bounds

    @property
    def detail_m(self) -> float:
        """The finest edge or detail of all objects."""
        finest = self.objects.rows[:, DETAIL]
        return float(finest.min()) if finest.size else math.inf

    @property
    def _tables(self) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        return *self.objects, *self.materials

    def _cof_at_point(self, x_m: float, y_m: float) -> float:
        cof: float = _lookup().scene_at(*self._tables, self.met, float(x_m), float(y_m))
        return cof

    def _cof_at_points(self, x_m: FloatArray, y_m: FloatArray) -> FloatArray:
        places = x_m.ravel(), y_m.ravel()
        cof: FloatArray = _lookup().scene_at_points(*self._tables, self.met, *places)
        return cof.reshape(x_m.shape)


def materials_of(textures: Iterable[Texture]) -> Materials:
    """Textures as rows and one pool of their tables. BadInputError for a scene among them."""
    rows, tables, start = [], [np.empty(0)], 0
    for texture in textures:
        row, table = _material(texture, start)
        rows.append(row)
        tables.append(table)
        start += table.size
    shape = len(rows), MATERIAL_COLUMNS
    return Materials(np.array(rows, float).reshape(shape), np.concatenate(tables))


def _material(texture: Texture, start: int) -> tuple[list[float], FloatArray]:
    """A row and its table, which starts there in the pool."""
    x_m = y_m = angle_rad = 0.0
    while isinstance(texture, Placed):
        c, s = math.cos(angle_rad), math.sin(angle_rad)
        x_m += c * texture.origin_x_m - s * texture.origin_y_m
        y_m += s * texture.origin_x_m + c * texture.origin_y_m
        angle_rad += texture.rotation_rad
        texture = texture.texture
    if not isinstance(texture, KINDS):
        said = "an object's texture is a scene itself"
        raise BadInputError("nested_scene", said, "give the objects of that scene")
    sizes, numbers, table = _content(texture)
    kind, turned = KINDS.index(type(texture)), (math.cos(angle_rad), math.sin(angle_rad))
    row = [kind, x_m, y_m, *turned, start, *_filled(sizes, 3), *_filled(numbers, 5)]
    return row, table


def _content(
    texture: Uniform | Grating | Profile | Waves | FrictionMap,
) -> tuple[list[float], list[float], FloatArray]:
    """Sizes of its tables, its numbers, and the tables one after another."""
    match texture:
        case Uniform():
            return [], [texture.cof], np.empty(0)
        case Grating():
            per_m = math.tau / texture.period_m
            waves = per_m * math.cos(texture.direction_rad), per_m * math.sin(texture.direction_rad)
            numbers = [texture.mean_cof, texture.amplitude_cof, *waves, texture.phase_rad]
            return [], numbers, np.empty(0)
        case Profile():
            table = np.array([*texture.position_m, *texture.cof])
            return [len(texture.cof)], _beyond(texture.outside), table
        case FrictionMap():
            numbers = [texture.pitch_x_m, texture.pitch_y_m, *_beyond(texture.outside)]
            return list(texture.cof.shape), numbers, texture.cof.ravel()
        case Waves():
            way = math.cos(texture.direction_rad), math.sin(texture.direction_rad)
            numbers = [texture.detail_m, *way, *texture.usual]
            tables = [texture.speed_m_s, texture.normal_force_n, texture.cof.ravel()]
            return list(texture.cof.shape), numbers, np.concatenate(tables)


def _beyond(outside: Outside) -> list[float]:
    """Whether it begins again or ends beyond."""
    return [float(outside == "tile"), float(outside == "nothing")]


def _filled(numbers: list[float], count: int) -> list[float]:
    return [*numbers, *[0.0] * (count - len(numbers))]


def _met_by(finger: FingerState) -> tuple[float, float]:
    return math.hypot(finger.velocity_x_m_s, finger.velocity_y_m_s), finger.normal_force_n


@cache
def _lookup() -> ModuleType:
    """Its functions are compiled: who lists textures does not wait for that."""
    return import_module("haptic_driver.render.scene_lookup")


def of_every_kind() -> list[Texture]:
    """Textures that are looked up by compiled functions, and one that is not."""
    cof = np.full((1, 1, 4), 0.7)
    kinds: list[Texture] = [
        Uniform(0.7),
        FrictionMap(cof[0], 0.01, 0.01, "tile"),
        Profile((0.0, 0.01), (0.7, 0.7), "tile"),
        Waves(cof, np.array([0.05]), np.array([0.5]), 0.01, 0.0, (0.05, 0.5)),
    ]
    row = np.zeros((1, OBJECT_COLUMNS))
    return [*kinds, Scene(Objects(row, np.empty((0, 2))), materials_of(kinds))]
