"""Objects of a scene as files and clients say them, in millimetres and degrees.

Without numpy, for which no client waits. x points right and y down from the screen's upper left
corner. An object is turned from x towards y about its place, which is the middle of its outline.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any, Literal, Self

from pydantic import ConfigDict, Field, model_validator

from haptic_driver.config import PRINTABLE, Checked
from haptic_driver.errors import BadInputError
from model.support.errors import nearest

MOST_OBJECTS = 500
MOST_CORNERS = 200  # of a polygon
TEXTURE_COF = (0.01, 5.0)  # what a file may say; the upper end is beyond any finger's
EMPTY = "the scene has no objects; haptic scene add makes one"
EVERYWHERE = "background"  # no object may be called so

Cof = Annotated[float, Field(ge=TEXTURE_COF[0], le=TEXTURE_COF[1])]
LengthMm = Annotated[float, Field(ge=0.001, le=10_000.0)]
OffsetMm = Annotated[float, Field(ge=-10_000.0, le=10_000.0)]
OriginMm = Annotated[list[OffsetMm], Field(min_length=2, max_length=2)]
Degrees = Annotated[float, Field(ge=-36_000.0, le=36_000.0)]
EdgeMm = Annotated[float, Field(ge=0.0, le=1000.0)]
SizeMm = Annotated[float, Field(ge=0.1, le=2000.0)]
Order = Annotated[int, Field(ge=-1000, le=1000)]
Id = Annotated[str, Field(min_length=1, max_length=100, pattern=PRINTABLE)]
FileName = Annotated[str, Field(min_length=1, max_length=1000)]
Fit = Literal["cover", "tile", "place"]


class _Said(Checked):
    model_config = ConfigDict(strict=True, allow_inf_nan=False)


# --- shapes


class Rectangle(_Said):
    """A rectangle, with round corners if you like."""

    kind: Literal["rectangle"] = "rectangle"
    width_mm: SizeMm = Field(description="along the object's own x")
    height_mm: SizeMm = Field(description="along its own y")
    radius_mm: Annotated[float, Field(ge=0.0, le=1000.0)] = Field(
        default=0.0, description="of its corners, half of the shorter side at most"
    )

    @model_validator(mode="after")
    def _is_round_enough(self) -> Self:
        if self.radius_mm > 0.5 * min(self.width_mm, self.height_mm):
            raise ValueError(f"key 'radius_mm': {self.radius_mm:g} is more than half of a side")
        return self


class Circle(_Said):
    """A circle."""

    kind: Literal["circle"] = "circle"
    radius_mm: SizeMm = Field(description="radius")


class Ellipse(_Said):
    """An ellipse."""

    kind: Literal["ellipse"] = "ellipse"
    width_mm: SizeMm = Field(description="along the object's own x")
    height_mm: SizeMm = Field(description="along its own y")


class Polygon(_Said):
    """Corners in order, around the object's place; where sides cross, every other part is in."""

    kind: Literal["polygon"] = "polygon"
    corners_mm: Annotated[list[OriginMm], Field(max_length=MOST_CORNERS)] = Field(
        description="x and y of each corner, from the object's place"
    )

    @model_validator(mode="after")
    def _has_an_inside(self) -> Self:
        corners = {(x, y) for x, y in self.corners_mm}
        if len(corners) < 3:
            raise ValueError(f"key 'corners_mm': {len(corners)} corners have no inside; give 3")
        return self


class Mask(_Said):
    """What is opaque in a PNG picture, or bright where it has no transparency; its middle is the
    object's place.
    """

    kind: Literal["mask"] = "mask"
    file: FileName = Field(description="PNG picture")
    width_mm: SizeMm = Field(description="of the picture")


AnyShape = Rectangle | Circle | Ellipse | Polygon | Mask
Shape = Annotated[AnyShape, Field(discriminator="kind")]


# --- objects and scenes


class SceneObject(_Said):
    """A shape at a place, with a friction or a texture that moves and turns with it."""

    id: Id = Field(description="by which it is changed, once in a scene")
    shape: Shape
    origin_mm: OriginMm = Field(description="its place: the middle of its outline")
    rotation_deg: Degrees = Field(default=0.0, description="turned about its place")
    cof: Cof | None = Field(default=None, description="friction; this or `texture`")
    texture: FileName | None = Field(
        default=None, description="name of a texture, or a file beside the scene"
    )
    fit: Fit = Field(
        default="cover",
        description=(
            "a map or profile that ends covers the outline (`cover`), repeats from its corner on"
            " (`tile`), or has its point 0, 0 at the object's place (`place`)"
        ),
    )
    order: Order = Field(
        default=0, description="the highest lies on top; of equals the one that was added last"
    )
    soft_edge_mm: EdgeMm = Field(
        default=0.0, description="width over which it fades into what is below; 0: at once"
    )
    enabled: bool = Field(default=True, description="whether it is there")

    @model_validator(mode="after")
    def _is_made_of_something(self) -> Self:
        if (self.cof is None) == (self.texture is None):
            raise ValueError("an object has either a cof or a texture")
        if self.id == EVERYWHERE:
            raise ValueError(f"no object may be called '{EVERYWHERE}'")
        return self


class _Filled(_Said):
    """A friction, a texture, or neither."""

    cof: Cof | None = Field(default=None, description="friction; this or `texture`")
    texture: FileName | None = Field(default=None, description="name of a texture, or a file")

    @model_validator(mode="after")
    def _is_one(self) -> Self:
        if self.cof is not None and self.texture is not None:
            raise ValueError("it has either a cof or a texture")
        return self


class Background(_Filled):
    """What is there where no object is: a friction, a texture, or nothing."""


class SceneDescription(_Said):
    """Objects on a background, each a shape with a friction or a texture; without a background the
    output is off between them.
    """

    kind: Literal["scene"] = "scene"
    description: str = Field(default="", description="in words")
    background: Background = Background()
    object: Annotated[list[SceneObject], Field(max_length=MOST_OBJECTS)] = Field(default=[])

    @model_validator(mode="after")
    def _has_each_id_once(self) -> Self:
        ids = [each.id for each in self.object]
        if doubled := sorted({each for each in ids if ids.count(each) > 1}):
            raise ValueError(f"key 'id': two objects are called '{doubled[0]}'")
        return self

    def changed(self, changes: Sequence[Change]) -> SceneDescription:
        """The scene after changes in order. BadInputError for one that cannot be, by its number."""
        objects, background = {each.id: each for each in self.object}, self.background
        for number, change in enumerate(changes, 1):
            try:
                match change:
                    case SetBackground():
                        background = Background(cof=change.cof, texture=change.texture)
                    case Clear():
                        objects = {}
                    case _:
                        _change_one(objects, change)
            except BadInputError as error:
                where = f"change {number}: " if len(changes) > 1 else ""
                raise BadInputError(error.code, f"{where}{error.message}", error.hint) from None
        if len(objects) > MOST_OBJECTS:
            said = f"{len(objects)} objects are more than {MOST_OBJECTS}"
            raise BadInputError("scene_too_large", said, "remove some")
        kept = {"background": background, "object": list(objects.values())}
        return self.model_copy(update=kept)


# --- changes


class Add(SceneObject):
    """Another object, on top of those of its order."""

    do: Literal["add"]

    def added(self) -> SceneObject:
        return SceneObject.model_construct(
            **{name: getattr(self, name) for name in SceneObject.model_fields}
        )


class Move(_Said):
    """An object's place."""

    do: Literal["move"]
    id: Id
    x_mm: OffsetMm
    y_mm: OffsetMm


class Turn(_Said):
    """How an object is turned."""

    do: Literal["turn"]
    id: Id
    rotation_deg: Degrees


class Set(_Filled):
    """What else an object is; what is left out stays."""

    do: Literal["set"]
    id: Id
    shape: Shape | None = None
    fit: Fit | None = None
    order: Order | None = None
    soft_edge_mm: EdgeMm | None = None
    enabled: bool | None = None


class Remove(_Said):
    """Take an object away."""

    do: Literal["remove"]
    id: Id


class Clear(_Said):
    """Take all objects away; the background stays."""

    do: Literal["clear"]


class SetBackground(_Filled):
    """Another background; without `cof` and `texture` none."""

    do: Literal["background"]


Change = Annotated[
    Add | Move | Turn | Set | Remove | Clear | SetBackground, Field(discriminator="do")
]


def _change_one(objects: dict[str, SceneObject], change: Add | Move | Turn | Set | Remove) -> None:
    if isinstance(change, Add):
        if change.id in objects:
            said = f"there is an object '{change.id}' already"
            raise BadInputError("object_exists", said, "give it another id, or remove the other")
        objects[change.id] = change.added()
        return
    found = objects.get(change.id)
    if found is None:
        said = f"there is no object '{change.id}' in the scene"
        hint = nearest(change.id, list(objects)) if objects else EMPTY
        raise BadInputError("unknown_object", said, hint)
    match change:
        case Move():
            new: dict[str, Any] = {"origin_mm": [change.x_mm, change.y_mm]}
        case Turn():
            new = {"rotation_deg": change.rotation_deg}
        case Remove():
            del objects[change.id]
            return
        case Set():
            said_to = {name: getattr(change, name) for name in change.model_fields_set}
            new = {n: v for n, v in said_to.items() if n not in ("do", "id") and v is not None}
            if "cof" in new:
                new["texture"] = None
            elif "texture" in new:
                new["cof"] = None
    objects[change.id] = found.model_copy(update=new)
