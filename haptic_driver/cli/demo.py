"""`haptic demo`: the main job on a simulated rig, with a table and a picture."""

from __future__ import annotations

import math
from itertools import pairwise
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from rich.table import Table

from haptic_driver.cli.output import Json, ModelOption, RigOption, names_of, progress, report, stdout
from haptic_driver.config import load_model, load_rig, texture_dirs
from haptic_driver.errors import BadInputError
from haptic_driver.files import not_written
from haptic_driver.simulated_rig import SimulatedRig
from haptic_driver.slides import WITHIN, Score, Slide, SlideRecord, read_slide, render_slide, score, synthetic_slide
from haptic_driver.stages import tick_settings
from haptic_driver.surface_builder import build_surface
from haptic_driver.surface_file import read_surface
from haptic_driver.textures.library import load_texture
from model.touch_model import TouchModel

TARGET_BINS = 6


def demo(
    trace: Annotated[Path | None, typer.Option("--trace", help="CSV: time_s, position_m, normal_force_n.")] = None,
    texture: Annotated[
        str,
        typer.Option(
            "--texture", help="Texture: a name in configs/textures or a path.", autocompletion=names_of("textures")
        ),
    ] = "grating",
    out: Annotated[Path, typer.Option("--out", help="Folder for the picture.")] = Path("out/demo"),
    model: ModelOption = "reference",
    surface: Annotated[Path | None, typer.Option("--surface", help="Surface file instead of building one.")] = None,
    rig: RigOption = "simulated",
    feedback: Annotated[
        bool,
        typer.Option("--feedback/--no-feedback", help="Learn the finger's gain, careful until it is known."),
    ] = False,
    as_json: Json = False,
) -> None:
    """Slide a finger over a texture on a simulated rig and compare friction with its target.

    Every command goes as bytes over TCP to a simulated generator; friction is read back through a simulated force
    sensor. Without `--trace` the finger makes two strokes of its own.

    Example: `haptic demo --texture grating --out out/demo`
    """
    config = load_rig(rig)
    if not config.simulated:
        raise BadInputError("not_simulated", f"rig {config.name} is not simulated", "haptic demo energises no hardware")
    description = load_model(model)
    slide = read_slide(trace) if trace is not None else synthetic_slide()
    wanted = load_texture(texture, texture_dirs())
    limits = config.operating_limits()
    file = read_surface(surface) if surface is not None else build_surface(description, limits)
    settings = tick_settings(config, file, wanted, feedback_latency_s=config.output.latency_s if feedback else None)
    finger = description if config.simulation.model is None else load_model(config.simulation.model)
    with SimulatedRig(config, TouchModel(finger)) as bench, progress("sliding", slide.time_s.size) as advance:
        record = render_slide(slide, wanted, settings, bench, advance)
    result = score(record)
    picture = _draw(record, texture, out)
    payload = {**vars(result), "simulated": True, "surface_hash": file.content_hash, "pictures": [str(picture)]}
    report(as_json, payload, lambda: _show(record, result, slide, texture, picture))


def _draw(record: SlideRecord, texture: str, out: Path) -> Path:
    from haptic_driver.pictures import draw_slide  # noqa: PLC0415  (matplotlib is slow to import)

    try:
        out.mkdir(parents=True, exist_ok=True)
        path = out / "friction.png"
        draw_slide(record, f"{texture} under the {record.slide.name}", path)
    except OSError as error:
        raise not_written(out, error) from error
    return path


def _show(record: SlideRecord, result: Score, slide: Slide, texture: str, picture: Path) -> None:
    stdout.print(f"texture {texture}, {slide.name}, on a [bold]simulated[/] rig")
    stdout.print(_table(record))
    share = result.share_within_5_percent
    judged = "nothing to judge: no" if math.isnan(share) else f"[bold]{share:.1%}[/] of"
    stdout.print(f"within 5 % of target: {judged} sliding contact time with a reachable target")
    stdout.print(
        f"contact {result.contact_time_s:.2f} s, of which sliding {result.sliding_time_s:.2f} s; "
        f"target reachable {result.reachable_share:.1%}; friction error {result.cof_error_rms:.4f} rms"
    )
    stdout.print(
        f"highest voltage {result.max_voltage_v:.1f} V peak; output on without contact "
        f"{result.output_on_without_contact_s:.3f} s; refused by the safety gate {record.rejections}"
    )
    stdout.print(f"output at the end: {record.off}")
    stdout.print(f"picture: {picture}")


def _table(record: SlideRecord) -> Table:
    """Target against achieved friction, by level of target."""
    table = Table(
        "target", "achieved", "error", "within 5 %", "time", title="friction while sliding", title_justify="left"
    )
    judged = record.sliding & record.reachable
    target, measured, error = record.target_cof[judged], record.measured_cof[judged], record.relative_error[judged]
    if not target.size:
        return table
    edges = np.linspace(target.min(), target.max() + 1e-9, TARGET_BINS + 1)
    for low, high in pairwise(edges):
        here = (target >= low) & (target < high)
        if here.any():
            table.add_row(
                f"{target[here].mean():.3f}",
                f"{measured[here].mean():.3f}",
                f"{100 * error[here].mean():+.2f} %",
                f"{100 * np.mean(np.abs(error[here]) <= WITHIN):.1f} %",
                f"{here.sum() * 1e-3:.2f} s",
            )
    return table
