"""`haptic scene`: objects on the screen of the daemon that is armed."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, TypeAlias

import typer
from typer import Argument, Option

from haptic_driver.cli.control import client_of, lease_token, show
from haptic_driver.cli.daemon import SocketOption
from haptic_driver.cli.output import Json, named, report, stdout
from haptic_driver.daemon.scene import (
    Made,
    Shaped,
    Together,
    circle,
    ellipse,
    mask,
    polygon,
    rectangle,
)
from haptic_driver.daemon.verbs import Verbs
from haptic_driver.errors import BadInputError
from haptic_driver.textures.objects import Fit

app = typer.Typer(no_args_is_help=True)

Id = Annotated[str, Argument(metavar="ID", help="Name of the object, once in a scene.")]
MadeOf = Annotated[str, named("textures", "Friction, or texture", Argument)]
Nearest = Annotated[bool, Option("--nearest", help="The nearest friction that is reachable.")]
Three: TypeAlias = tuple[float, float, float]
Four: TypeAlias = tuple[float, float, float, float]
Five: TypeAlias = tuple[float, float, float, float, float]


@app.command()
def add(
    name: Id,
    made_of: MadeOf,
    round_: Annotated[Three | None, Option("--circle", help="X Y RADIUS, mm.")] = None,
    box: Annotated[Four | None, Option("--rectangle", help="X Y WIDTH HEIGHT, mm.")] = None,
    soft_box: Annotated[
        Five | None, Option("--rounded", help="X Y WIDTH HEIGHT RADIUS, mm: with round corners.")
    ] = None,
    oval: Annotated[Four | None, Option("--ellipse", help="X Y WIDTH HEIGHT, mm.")] = None,
    corners: Annotated[
        str | None, Option("--polygon", help='Corners, mm: "10,10 20,10 15,20".')
    ] = None,
    picture: Annotated[
        tuple[str, float, float, float] | None,
        Option("--mask", help="PNG X Y WIDTH, mm: the outline of a picture."),
    ] = None,
    turn_deg: Annotated[float, Option("--turn", help="Degrees, from x towards y.")] = 0.0,
    order: Annotated[int, Option(help="The highest lies on top.")] = 0,
    soft_edge: Annotated[float, Option(help="mm, over which it fades into what is below.")] = 0.0,
    fit: Annotated[
        Fit, Option(help="A map or profile covers it, repeats, or has its 0, 0 at the middle.")
    ] = "cover",
    nearest: Nearest = False,
    socket: SocketOption = None,
    as_json: Json = False,
) -> None:
    """Add an object of a friction or a texture, by its middle and one of the shapes.

    Example: `haptic scene add key linen --circle 30 20 8`
    """
    made = _made(made_of)
    shapes = [
        circle(*round_) if round_ else None,
        rectangle(*box) if box else None,
        rectangle(*soft_box) if soft_box else None,
        ellipse(*oval) if oval else None,
        _polygon(corners) if corners else None,
        mask(picture[1], picture[2], picture[0], picture[3]) if picture else None,
    ]
    where = [shape for shape in shapes if shape is not None]
    if len(where) != 1:
        said = f"{name}: {len(where)} shapes are given"
        raise BadInputError("bad_shape", said, "Give one, such as --circle 30 20 8")
    _ask(
        lambda scene: scene.add(name, where[0], made, turn_deg, order, soft_edge, fit=fit),
        socket,
        as_json,
        nearest=nearest,
    )


@app.command()
def move(
    name: Id,
    x_mm: Annotated[float, Argument(metavar="X", help="mm.")],
    y_mm: Annotated[float, Argument(metavar="Y", help="mm.")],
    socket: SocketOption = None,
    as_json: Json = False,
) -> None:
    """Move an object to a place.

    Example: `haptic scene move key 40 20`
    """
    _ask(lambda scene: scene.move(name, x_mm, y_mm), socket, as_json)


@app.command()
def turn(
    name: Id,
    rotation_deg: Annotated[float, Argument(metavar="DEG", help="From x towards y.")],
    socket: SocketOption = None,
    as_json: Json = False,
) -> None:
    """Turn an object about its place.

    Example: `haptic scene turn key 45`
    """
    _ask(lambda scene: scene.turn(name, rotation_deg), socket, as_json)


@app.command("set")
def set_(
    name: Id,
    made_of: Annotated[str | None, Option("--of", help="Friction, or name of a texture.")] = None,
    order: Annotated[int | None, Option(help="The highest lies on top.")] = None,
    soft_edge: Annotated[float | None, Option(help="mm.")] = None,
    enabled: Annotated[
        bool | None, Option("--enabled/--disabled", help="Whether it is there.")
    ] = None,
    nearest: Nearest = False,
    socket: SocketOption = None,
    as_json: Json = False,
) -> None:
    """Change what an object is; what is not given stays.

    Example: `haptic scene set key --of 0.7 --soft-edge 1`
    """
    made = None if made_of is None else _made(made_of)
    _ask(
        lambda scene: scene.set(name, made, None, order, soft_edge, enabled),
        socket,
        as_json,
        nearest=nearest,
    )


@app.command()
def remove(name: Id, socket: SocketOption = None, as_json: Json = False) -> None:
    """Take an object away.

    Example: `haptic scene remove key`
    """
    _ask(lambda scene: scene.remove(name), socket, as_json)


@app.command()
def clear(socket: SocketOption = None, as_json: Json = False) -> None:
    """Take all objects away; the background stays.

    Example: `haptic scene clear`
    """
    _ask(lambda scene: scene.clear(), socket, as_json)


@app.command()
def background(
    made_of: Annotated[str | None, Argument(help="Friction, or texture; none: output off.")] = None,
    nearest: Nearest = False,
    socket: SocketOption = None,
    as_json: Json = False,
) -> None:
    """Say what is felt where no object is.

    Example: `haptic scene background 0.55`
    """
    _ask(
        lambda scene: scene.background(None if made_of is None else _made(made_of)),
        socket,
        as_json,
        nearest=nearest,
    )


@app.command()
def change(
    file: Annotated[Path, Argument(help='JSON: a list such as [{"do": "move", "id": ...}].')],
    nearest: Nearest = False,
    socket: SocketOption = None,
    as_json: Json = False,
) -> None:
    """Make several changes at one tick, as the API takes them.

    Example: `haptic scene change moves.json`
    """
    try:
        said = json.loads(file.read_text(encoding="utf-8"))
    except ValueError as error:
        raise BadInputError("bad_request", f"{file}: {error}", "Give a list as JSON") from None
    _ask(lambda scene: setattr(scene, "kept", said), socket, as_json, nearest=nearest)


@app.command("show")
def show_scene(socket: SocketOption = None, as_json: Json = False) -> None:
    """Render the scene, also after the output was switched off.

    Example: `haptic scene show`
    """
    with client_of(socket) as client:
        answer = client.ask(Verbs.change_scene, {"show": True}, lease_token(client.address))
    show(as_json, answer)


@app.command("list")
def list_objects(socket: SocketOption = None, as_json: Json = False) -> None:
    """List the objects of the present scene.

    Example: `haptic scene list`
    """
    with client_of(socket) as client:
        shown = client.scene_shown()

    def lines() -> None:
        for each in shown.scene.object if shown.scene else []:
            x_mm, y_mm = each.origin_mm
            made = each.texture if each.cof is None else f"friction {each.cof:g}"
            off = "" if each.enabled else ", disabled"
            stdout.print(f"{each.id}: {each.shape.kind} at {x_mm:g}, {y_mm:g} mm, {made}{off}")
        if not shown.scene or not shown.scene.object:
            stdout.print("no objects")

    report(as_json, shown.model_dump(mode="json"), lines)


def _ask(
    change: Callable[[Together], object],
    socket: str | None,
    as_json: bool,
    *,
    nearest: bool = False,
) -> None:
    scene = Together()
    change(scene)
    with client_of(socket) as client:
        said = {"changes": scene.kept, "nearest": nearest}
        answer = client.ask(Verbs.change_scene, said, lease_token(client.address))
    show(as_json, answer)


def _made(said: str) -> Made:
    """A friction where it is a number, else a texture."""
    try:
        return float(said)
    except ValueError:
        return said


def _polygon(said: str) -> Shaped:
    """Its place is the middle of the box around its corners."""
    try:
        corners = [[float(cell) for cell in corner.split(",")] for corner in said.split()]
        xs, ys = zip(*corners, strict=True)
    except ValueError:
        raise BadInputError(
            "bad_shape", f"--polygon {said}: is no list of corners", 'Give "10,10 20,10 15,20"'
        ) from None
    x_mm, y_mm = 0.5 * (min(xs) + max(xs)), 0.5 * (min(ys) + max(ys))
    return polygon(x_mm, y_mm, [[x - x_mm, y - y_mm] for x, y in corners])
