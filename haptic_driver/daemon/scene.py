"""A scene of a daemon from Python: objects on the screen, by their ids.

    from haptic_driver.client import HapticClient, circle

    with HapticClient() as client, client.armed() as rig:
        rig.scene.add("key", circle(30.0, 20.0, 8.0), "linen")
        with rig.scene.together() as scene:  # all at one tick
            scene.move("key", 35.0, 20.0)
            scene.turn("key", 10.0)

Places and sizes are in millimetres from the screen's upper left corner, x to the right, y down. The
first change begins a scene and renders it. What is changed after somebody has switched off is not
rendered before `show`.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, NamedTuple

from haptic_driver.config import parse
from haptic_driver.daemon.messages import SceneChanged, SceneShown
from haptic_driver.daemon.verbs import named_from_anywhere, whole_path
from haptic_driver.textures.objects import (
    AnyShape,
    Circle,
    Ellipse,
    Fit,
    Mask,
    Polygon,
    Rectangle,
    SceneDescription,
)

Made = float | str  # of a friction, or of the texture of that name


class Shaped(NamedTuple):
    """A shape at a place, as the functions below make it."""

    shape: AnyShape
    x_mm: float
    y_mm: float


def rectangle(
    x_mm: float, y_mm: float, width_mm: float, height_mm: float, radius_mm: float = 0.0
) -> Shaped:
    """A rectangle around a place; `radius_mm` is that of its corners."""
    outline = _made(Rectangle, width_mm=width_mm, height_mm=height_mm, radius_mm=radius_mm)
    return Shaped(outline, x_mm, y_mm)


def circle(x_mm: float, y_mm: float, radius_mm: float) -> Shaped:
    """A circle around a place."""
    return Shaped(_made(Circle, radius_mm=radius_mm), x_mm, y_mm)


def ellipse(x_mm: float, y_mm: float, width_mm: float, height_mm: float) -> Shaped:
    """An ellipse around a place."""
    return Shaped(_made(Ellipse, width_mm=width_mm, height_mm=height_mm), x_mm, y_mm)


def polygon(x_mm: float, y_mm: float, corners_mm: Sequence[Sequence[float]]) -> Shaped:
    """Corners [x, y], each as far from the place as it says."""
    corners = [[float(value) for value in corner] for corner in corners_mm]
    return Shaped(_made(Polygon, corners_mm=corners), x_mm, y_mm)


def mask(x_mm: float, y_mm: float, file: str, width_mm: float) -> Shaped:
    """The outline of a PNG picture as wide, its middle at a place."""
    return Shaped(_made(Mask, file=whole_path(file), width_mm=width_mm), x_mm, y_mm)


def _made(shape: type[Any], **said: Any) -> Any:
    return parse(shape, said, f"a {shape.model_fields['kind'].default}", "bad_shape")


class Changes(ABC):
    """What can be done to a scene. Raises BadInputError for what cannot be."""

    def add(
        self,
        name: str,
        where: Shaped,
        made: Made,
        rotation_deg: float = 0.0,
        order: int = 0,
        soft_edge_mm: float = 0.0,
        enabled: bool = True,
        fit: Fit = "cover",
    ) -> SceneChanged | None:
        """An object of a friction, or of a texture that moves and turns with it.

        The highest `order` lies on top. It fades into what is below over `soft_edge_mm`. A map or
        profile covers the outline, or is there as another `fit` says.
        """
        said = {"shape": where.shape.model_dump(), "origin_mm": [where.x_mm, where.y_mm]}
        more = {"rotation_deg": rotation_deg, "order": order, "soft_edge_mm": soft_edge_mm}
        return self._do("add", name, **said, **more, enabled=enabled, fit=fit, **_of(made))

    def move(self, name: str, x_mm: float, y_mm: float) -> SceneChanged | None:
        """An object's place."""
        return self._do("move", name, x_mm=float(x_mm), y_mm=float(y_mm))

    def turn(self, name: str, rotation_deg: float) -> SceneChanged | None:
        """How an object is turned about its place, from x towards y."""
        return self._do("turn", name, rotation_deg=float(rotation_deg))

    def set(
        self,
        name: str,
        made: Made | None = None,
        shape: AnyShape | None = None,
        order: int | None = None,
        soft_edge_mm: float | None = None,
        enabled: bool | None = None,
    ) -> SceneChanged | None:
        """What else an object is; what is left out stays."""
        said: dict[str, Any] = {"order": order, "soft_edge_mm": soft_edge_mm, "enabled": enabled}
        said |= {"shape": None if shape is None else shape.model_dump()}
        said |= {} if made is None else _of(made)
        return self._do("set", name, **{k: v for k, v in said.items() if v is not None})

    def remove(self, name: str) -> SceneChanged | None:
        return self._do("remove", name)

    def clear(self) -> SceneChanged | None:
        """No objects; the background stays."""
        return self._do("clear")

    def background(self, made: Made | None) -> SceneChanged | None:
        """What is there where no object is; None: nothing, with the output off."""
        return self._do("background", **({} if made is None else _of(made)))

    @abstractmethod
    def _do(self, do: str, name: str | None = None, **said: Any) -> SceneChanged | None: ...


class Together(Changes):
    """Changes that are kept, to take effect at one tick."""

    def __init__(self) -> None:
        self.kept: list[dict[str, Any]] = []

    def _do(self, do: str, name: str | None = None, **said: Any) -> None:
        self.kept.append({"do": do, **({} if name is None else {"id": name}), **said})


class Scene(Changes):
    """The scene of a daemon whose lease is held. `ask` takes changes, and whether to show."""

    def __init__(
        self,
        ask: Callable[[list[dict[str, Any]], bool], SceneChanged],
        shown: Callable[[], SceneShown],
    ) -> None:
        self._ask = ask
        self._shown = shown

    @contextmanager
    def together(self) -> Iterator[Together]:
        """What is changed in the block takes effect at one tick, at its end; nothing of it where
        the block fails.
        """
        changes = Together()
        yield changes
        self._ask(changes.kept, False)

    def change(self, changes: Sequence[dict[str, Any]]) -> SceneChanged:
        """Changes as the API takes them, at one tick."""
        return self._ask(list(changes), False)

    def show(self) -> SceneChanged:
        """Render it, also after the output was switched off."""
        return self._ask([], True)

    @property
    def described(self) -> SceneDescription | None:
        """What it is at present; None where there is none."""
        return self._shown().scene

    def _do(self, do: str, name: str | None = None, **said: Any) -> SceneChanged:
        return self._ask([{"do": do, **({} if name is None else {"id": name}), **said}], False)


def _of(made: Made) -> dict[str, Any]:
    if isinstance(made, str):
        return {"texture": named_from_anywhere(made)}
    return {"cof": float(made)}
