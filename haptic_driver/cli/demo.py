"""`haptic demo`: the main job on a simulated rig, with a table and a picture."""

from __future__ import annotations

from dataclasses import asdict
from itertools import pairwise
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from rich.table import Table
from rich.text import Text
from typer import Option

from haptic_driver.cli.output import (
    SIMULATED,
    Json,
    ModelOption,
    RigOption,
    named,
    progress,
    report,
    stdout,
)
from haptic_driver.config import texture_dirs
from haptic_driver.daemon.set_up import render_settings
from haptic_driver.daemon.stepped import render_slide
from haptic_driver.errors import BadInputError
from haptic_driver.fidelity.perception import load_perception
from haptic_driver.fidelity.said import said
from haptic_driver.fidelity.sliding import AFTER_TOUCH_S
from haptic_driver.lookup.build import build_surface
from haptic_driver.lookup.file import SurfaceFile, read_surface
from haptic_driver.lookup.models import load_model
from haptic_driver.pictures.friction_pictures import draw_slide
from haptic_driver.rig.config import load_rig
from haptic_driver.rig.slide import read_slide, synthetic_slide
from haptic_driver.signals import WITHIN
from haptic_driver.simulation.rig import SimulatedRig
from haptic_driver.simulation.slide import Score, SlideRecord, score
from haptic_driver.textures.library import load_texture
from model.description import ModelDescription
from model.touch_model import TouchModel

MOSTLY = 0.5  # of the sliding time
TARGET_BINS = 6


def demo(
    context: typer.Context,
    trace: Annotated[Path | None, Option(help="CSV: time_s, position_m, normal_force_n.")] = None,
    texture: Annotated[str, named("textures", "Texture")] = "grating",
    out: Annotated[Path, Option(help="Folder for the picture.")] = Path("out/demo"),
    model: ModelOption = "reference",
    surface: Annotated[Path | None, Option(help="Surface file of that model.")] = None,
    rig: RigOption = "simulated",
    feedback: Annotated[
        bool,
        Option("--feedback/--no-feedback", help="Learn the finger's gain, as the daemon does."),
    ] = True,
    perception: Annotated[
        str, named("perception", "Thresholds of what a finger feels")
    ] = "published",
    as_json: Json = False,
) -> None:
    """Slide a finger over a texture on a simulated rig and compare friction with its target.

    Of a real rig its figures are taken, and simulated instruments: no hardware is energised.
    It renders as the daemon does, by the same parts, in simulated time. Commands go as bytes over
    TCP to a simulated generator. Friction is read back through a simulated force sensor, or
    estimated where the rig's file has none. Without `--trace` the finger makes two strokes of its
    own. The finger follows `--model`, from which the surface is built, unless the rig's file names
    another.

    Example: `haptic demo --texture grating --out out/demo`
    """
    config = load_rig(rig)
    description = load_model(model)
    slide = read_slide(trace) if trace is not None else synthetic_slide()
    wanted = load_texture(texture, texture_dirs())
    if surface is None:
        file = build_surface(description, config.operating_limits())
    else:
        file = read_surface(surface)
        if config.simulation.model is None or _given(context, "model"):
            _require_same_model(surface, file, description)
    thresholds = load_perception(perception)
    finger = description if config.simulation.model is None else load_model(config.simulation.model)
    bench = SimulatedRig(config, TouchModel(finger), envelope=True)
    settings = render_settings(bench.config, file, feedback=feedback)
    with bench, progress("sliding", slide.time_s.size) as advance:
        record = render_slide(slide, wanted, settings, bench, advance, model)
    result = score(record, thresholds)
    picture = out / "friction.png"
    draw_slide(record, f"{texture}: {slide.name}", picture)
    counts = {name: value for name, value in vars(result).items() if name != "fidelity"}
    known = {"simulated": True, "surface_hash": file.content_hash, "pictures": [str(picture)]}
    payload = asdict(result.fidelity) | counts | known | _felt(record)
    of_what = "rig" if config.simulated else f"copy of rig {rig}"
    what = Text.assemble(f"texture {texture}, {slide.name}, on a ", SIMULATED, f" {of_what}")
    for device in bench.left_out:
        what.append(f"\nleft out, {device}")
    payload["left_out"] = bench.left_out
    report(as_json, payload, lambda: _show(record, result, what, picture))


def _felt(record: SlideRecord) -> dict[str, float | None]:
    """Mean friction while sliding, measured or estimated, and the gain that feedback found; null
    for what there is not.
    """
    names = ("measured_cof", "estimated_cof", "estimated_cof_std", "feedback_gain")
    columns = {name: record.samples[name][record.sliding] for name in names}
    known = {name: column[np.isfinite(column)] for name, column in columns.items()}
    return {name: float(some.mean()) if some.size else None for name, some in known.items()}


def _given(context: typer.Context, name: str) -> bool:
    """Whether an option stands on the command line."""
    source = context.get_parameter_source(name)
    return source is not None and source.name == "COMMANDLINE"


def _require_same_model(path: Path, file: SurfaceFile, description: ModelDescription) -> None:
    """A finger of another model than the surface's would be off target for a reason that nothing
    shows.
    """
    if file.provenance.get("model_hash") != description.content_hash:
        built_from, name = file.provenance["model"]["name"], description.name
        said = f"'{built_from}'" + (" as it was then" if built_from == name else "")
        raise BadInputError(
            "other_model",
            f"{path} was built from model {said}, which is not model '{name}'",
            "Give the surface's model as --model, or build the surface anew: haptic surface build."
            " For a finger that differs on purpose, name its model in the rig's file: [simulation]"
            " model",
        )


def _show(record: SlideRecord, result: Score, what: Text, picture: Path) -> None:
    stdout.print(what)
    felt = _felt(record)
    contact = f"contact {result.contact_time_s:.2f} s"
    if record.is_estimated:
        stdout.print(
            f"no force sensor: friction is not measured; estimated {felt['estimated_cof']:.3f}"
            f" ± {felt['estimated_cof_std']:.3f} in the mean, of a target of"
            f" {record.target_cof[record.sliding].mean():.3f}"
        )
        stdout.print(contact)
    else:
        stdout.print(_table(record) or _out_of_reach(record))
        for sentence in said(result.fidelity):
            stdout.print(sentence)
        stdout.print(
            f"{contact}, judged from {1e3 * AFTER_TOUCH_S:.0f} ms after"
            f" each touch: {result.fidelity.sliding_time_s:.2f} s of sliding"
        )
    gain = felt["feedback_gain"]
    if gain is not None and abs(gain - 1.0) > WITHIN:
        stdout.print(_of_gain(gain, result.fidelity.reachable_share))
    stdout.print(
        f"highest voltage {result.max_voltage_v:.1f} V peak; output on without contact"
        f" {result.output_on_without_contact_s:.3f} s; refused by the safety gate"
        f" {record.rejections}"
    )
    stdout.print(f"output at the end: {record.off}")
    stdout.print(f"picture: {picture}")


def _of_gain(gain: float, reachable_share: float | None) -> str:
    """What feedback makes of a finger that is not the model's."""
    if reachable_share is not None and reachable_share < MOSTLY:
        return (
            f"feedback found a gain of {gain:.2f}, and most targets are beyond what this finger"
            " reaches then: no feedback closes that; --no-feedback shows the model alone"
        )
    return (
        f"friction is {gain:.2f} times what the model says, in the mean: feedback closes what is"
        " missing; --no-feedback shows it"
    )


def _out_of_reach(record: SlideRecord) -> str:
    """Why there is nothing to compare."""
    asked, given = (
        values[record.sliding] for values in (record.target_cof, record.samples["expected_cof"])
    )
    if not np.isfinite(asked).any():
        return "nothing was asked for under a sliding finger"
    said = (
        f"targets are {np.nanmin(asked):.3f} to {np.nanmax(asked):.3f}, and the nearest that this"
        f" rig gives by the model is {np.nanmin(given):.3f} to {np.nanmax(given):.3f}"
    )
    if np.nanmax(asked) < np.nanmin(given):
        return f"{said}: friction without voltage is higher"
    return f"{said}: its limits are too low for them"


def _table(record: SlideRecord) -> Table | None:
    """Target against achieved friction, by level of target; None where none was within reach."""
    table = Table(
        "target",
        "achieved",
        "error",
        "within 5 %",
        "time",
        title="friction while sliding",
        title_justify="left",
    )
    judged = record.sliding & (record.samples["reachable"] == 1)
    target, measured = record.target_cof[judged], record.measured_cof[judged]
    if not target.size:
        return None
    error = measured / target - 1.0
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
