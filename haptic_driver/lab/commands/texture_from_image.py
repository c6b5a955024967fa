"""`haptic texture from-image`: a photograph or drawing as a texture, in one try."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from rich.text import Text
from typer import Argument, Option

from haptic_driver.cli.output import Json, ModelOption, RigOption, report, stdout
from haptic_driver.cli.output import status as shown_status
from haptic_driver.errors import BadInputError, require_range
from haptic_driver.files import require_ending, require_free, write_text
from haptic_driver.lab.importers.image import PERCENTILES, Method
from haptic_driver.textures.objects import TEXTURE_COF
from model.support.toml import toml_lines

if TYPE_CHECKING:
    from haptic_driver.lab.importers.image import Mapped
    from haptic_driver.signals import Array

WIDTH_MM = (1.0, 2000.0)
USUAL_N = 0.5  # load of a finger, for which reach is reported
MUCH = 0.1  # of what is asked for (rms), out of reach: worth a warning


def texture_from_image(
    source: Annotated[Path, Argument(help="JPEG, PNG, TIFF or any other picture.")],
    width_mm: Annotated[float, Option(help="Width of the picture on the screen.")],
    cof: Annotated[tuple[float, float], Option(help="Lowest and highest friction.")] = (0.55, 0.80),
    method: Annotated[Method, Option(help="What of the picture is felt.")] = "luminance",
    direction_deg: Annotated[
        float, Option(help="height: the way of strokes, from x towards y.")
    ] = 0.0,
    percentiles: Annotated[
        tuple[float, float], Option(help="Of brightness, which become the ends.")
    ] = PERCENTILES,
    rig: RigOption = "simulated",
    model: ModelOption = "reference",
    speed: Annotated[float, Option(help="Speed of the finger, m/s.")] = 0.05,
    out: Annotated[Path | None, Option(help="Texture to write, .toml.")] = None,
    force: Annotated[bool, Option("--force", help="Overwrite what is there.")] = False,
    play: Annotated[bool, Option("--play", help="Play it on the armed daemon.")] = False,
    as_json: Json = False,
) -> None:
    """Make a texture of a picture: by its brightness, its height or its edges.

    Beside the texture it writes the map that the texture names. It also draws what is asked for,
    what this rig and a usual finger make of it, and what was cut of the picture's brightness.

    Example: `haptic texture from-image photo.jpg --width-mm 60 --cof 0.55 0.80`
    """
    from haptic_driver.cli.texture import SPEED_M_S  # noqa: PLC0415  (slow to import)
    from haptic_driver.lab.importers.image import friction_shares, read_picture, save_grey  # noqa: PLC0415

    target = source.with_suffix(".toml") if out is None else out
    grey, preview = (target.with_name(f"{target.stem}_{what}.png") for what in ("map", "preview"))
    _require_usable(target, [target, grey, preview], cof, percentiles, force=force)
    require_range("--width-mm", width_mm, *WIDTH_MM, unit=" mm")
    require_range("--speed", speed, *SPEED_M_S, unit=" m/s")
    with shown_status("texture") as tell:
        tell(f"reading {source.name}")
        picture = read_picture(source, width_mm)
        mapped = friction_shares(picture, method, direction_deg, percentiles)
    low, high = cof
    asked = low + (high - low) * mapped.shares
    size_mm = [picture.pitch_mm * side for side in reversed(asked.shape)]
    with shown_status("texture") as tell:
        tell(f"drawing {preview.name}")
        warnings = _look(asked, picture.pitch_mm, mapped, preview, rig, model, speed)
    save_grey(mapped.shares, grey)
    texture = {
        "kind": "map",
        "description": _printable(f"from {source.name}, {method}: {'; '.join(mapped.done)}"),
        "file": _printable(grey.name),
        "cof_black": low,
        "cof_white": high,
        "pitch_mm": picture.pitch_mm,
    }
    write_text(target, toml_lines(texture))
    if play:
        _play(target)
    if method == "height":
        warnings.append("strokes the other way feel its hills as hollows: a map knows no direction")
    payload: dict[str, Any] = {
        "texture": str(target),
        "map": str(grey),
        "preview": str(preview),
        "size_mm": size_mm,
        "method": method,
        "cof": [float(asked.min()), float(asked.max())],
        "done": mapped.done,
        "warnings": warnings,
    }

    def show() -> None:
        stdout.print(f"texture: {target}, {size_mm[0]:.4g} by {size_mm[1]:.4g} mm, by {method}")
        for words in mapped.done:
            stdout.print(f"  {words}")
        for words in warnings:
            stdout.print(Text(f"  {words}", "bold yellow"))
        stdout.print(f"asked and rendered: {preview}")
        stdout.print(
            "it plays" if play else f"play it: haptic texture play {shlex.quote(str(target))}"
        )

    report(as_json, payload, show)


def _play(texture: Path) -> None:
    """Play it, or what comes nearest within reach, by the lease that `haptic arm` left."""
    from haptic_driver.cli.control import client_of, lease_token  # noqa: PLC0415  (slow to import)
    from haptic_driver.daemon.verbs import Verbs  # noqa: PLC0415

    with client_of(None) as client:
        asked = {"name": str(texture.absolute()), "nearest": True}
        client.ask(Verbs.play, asked, lease_token(client.address))


def _require_usable(
    target: Path,
    written: list[Path],
    cof: tuple[float, float],
    percentiles: tuple[float, float],
    *,
    force: bool,
) -> None:
    require_ending(target, [".toml"])
    if not TEXTURE_COF[0] <= cof[0] < cof[1] <= TEXTURE_COF[1]:
        said = f"--cof {cof[0]:g} {cof[1]:g} is no range of friction"
        raise BadInputError("out_of_range", said, "Give the lower first: --cof 0.55 0.80")
    if not 0.0 <= percentiles[0] < percentiles[1] <= 100.0:
        said = f"--percentiles {percentiles[0]:g} {percentiles[1]:g} is no range"
        raise BadInputError("out_of_range", said, "Give for example: --percentiles 2 98")
    for path in written:
        require_free(path, force)


def _look(
    asked: Array, pitch_mm: float, mapped: Mapped, preview: Path, rig: str, model: str, speed: float
) -> list[str]:
    """Draw what is asked for and what comes of it; what this rig cannot render, in words."""
    from haptic_driver.cli.texture import controller_of, output_of  # noqa: PLC0415
    from haptic_driver.lab.importers.image import rendered  # noqa: PLC0415
    from haptic_driver.lab.pictures.from_image import asked_and_rendered  # noqa: PLC0415
    from haptic_driver.render.texture import FrictionMap  # noqa: PLC0415
    from haptic_driver.rig.config import load_rig  # noqa: PLC0415
    from haptic_driver.textures.bands import asked as asked_in_bands  # noqa: PLC0415
    from haptic_driver.textures.bands import predicted  # noqa: PLC0415

    config = load_rig(rig)
    reach = controller_of(config, model, None, USUAL_N).reachable(USUAL_N)
    output, pitch_m = output_of(config), 1e-3 * pitch_mm
    felt = rendered(asked, pitch_m, speed, reach, output)
    title = f"at {1e3 * speed:g} mm/s on {config.name}"
    asked_and_rendered(asked, felt, pitch_mm, mapped, preview, title)
    warnings = []
    low, high = float(asked.min()), float(asked.max())
    if low < reach[0] or high > reach[1]:
        warnings.append(
            f"friction {low:.3g} to {high:.3g} is asked for, {reach[0]:.3g} to {reach[1]:.3g} is"
            f" within reach at {USUAL_N:g} N"
        )
    size_m = (asked.shape[1] * pitch_m, asked.shape[0] * pitch_m)
    rms, mean = asked_in_bands(FrictionMap(asked, pitch_m, pitch_m), speed, size_m)
    bands = predicted(rms, mean, reach, output, speed)
    whole = sum(band.asked_cof_rms**2 for band in bands)
    lost = [band for band in bands if band.verdict == "out_of_reach"]
    share = sum(band.asked_cof_rms**2 for band in lost) / whole if whole > 0.0 else 0.0
    if share > MUCH:
        hz = f"{min(b.low_hz for b in lost):.3g} to {max(b.high_hz for b in lost):.3g} Hz"
        coarser_mm = 1e3 * speed / min(band.low_hz for band in lost)
        warnings.append(
            f"{share:.0%} of its detail lies at {hz} at this speed, which this rig cannot render:"
            f" slide slower, or make the picture wider (waves longer than {coarser_mm:.2g} mm)"
        )
    return warnings


def _printable(text: str) -> str:
    return "".join(letter if letter.isprintable() else "?" for letter in text)
