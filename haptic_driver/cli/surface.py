"""`haptic surface`: build, describe and draw lookup surfaces."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from typer import Argument, Option

from haptic_driver.cli.output import Json, ModelOption, RigOption, report, stderr, stdout
from haptic_driver.lookup.build import SurfaceAxes, axes_within, build_surface
from haptic_driver.lookup.file import SurfaceFile, read_surface
from haptic_driver.lookup.models import load_model
from haptic_driver.rig.config import load_rig

app = typer.Typer(no_args_is_help=True)
AXES = SurfaceAxes()


@app.command()
def build(
    model: ModelOption = "reference",
    out: Annotated[Path, Option(help="HDF5 file to write.")] = Path("surface.h5"),
    rig: RigOption = "simulated",
    frequency_count: Annotated[int, Option(help="Points along frequency.")] = AXES.frequency_count,
    voltage_count: Annotated[int, Option(help="Points along voltage.")] = AXES.voltage_count,
    force_count: Annotated[
        int, Option(help="Points along normal force.")
    ] = AXES.normal_force_count,
    voltage_high_v: Annotated[
        float | None, Option(help=f"Highest voltage, V peak (by default {AXES.voltage_high_v:g}).")
    ] = None,
    interval: Annotated[
        bool, Option(help="Store how far friction may be off (about a second).")
    ] = True,
    as_json: Json = False,
) -> None:
    """Solve the model over frequency, voltage and normal force and write the surface.

    A model with a learned effect has a range: frequency and normal force, and voltage unless it is
    given, end there.

    Example: `haptic surface build --model reference --out surface.h5`
    """
    description = load_model(model)
    counts = SurfaceAxes(
        frequency_count=frequency_count, voltage_count=voltage_count, normal_force_count=force_count
    )
    axes = axes_within(description, counts)
    if axes != counts:
        stderr.print(
            f"note: the surface ends where effect learned of model '{description.name}' does"
        )
    if voltage_high_v is not None:
        axes = replace(axes, voltage_high_v=voltage_high_v)
    surface = build_surface(description, load_rig(rig).operating_limits(), axes, interval)
    surface.write(out)
    payload = {"out": str(out), **describe(surface)}
    report(as_json, payload, lambda: stdout.print(f"{out}: {_summary(surface)}"))


@app.command()
def info(
    file: Annotated[Path, Argument(help="Surface file.")] = Path("surface.h5"),
    as_json: Json = False,
) -> None:
    """Say what a surface file holds and where it comes from; checks its content hash.

    Example: `haptic surface info surface.h5`
    """
    surface = read_surface(file)
    payload = {"file": str(file), **describe(surface)}

    def show() -> None:
        stdout.print(f"{file}: {_summary(surface)}")
        _tell(payload, "  ")

    report(as_json, payload, show)


@app.command()
def plot(
    file: Annotated[Path, Argument(help="Surface file.")] = Path("surface.h5"),
    out: Annotated[Path, Option(help="Picture to write (.png, .pdf or .svg).")] = Path(
        "surface.png"
    ),
    normal_force: Annotated[float, Option(help="Normal force of the drawn section, N.")] = 0.5,
    as_json: Json = False,
) -> None:
    """Draw friction over frequency and voltage, with what the limits forbid.

    Example: `haptic surface plot surface.h5 --out surface.png`
    """
    # matplotlib is slow to import
    from haptic_driver.pictures.friction_pictures import draw_surface  # noqa: PLC0415

    draw_surface(read_surface(file), normal_force, out)
    report(
        as_json,
        {"picture": str(out), "normal_force_n": normal_force},
        lambda: stdout.print(f"picture: {out}"),
    )


def describe(surface: SurfaceFile) -> dict[str, Any]:
    """What `surface info --json` says."""
    axes = {
        name: {"low": float(v[0]), "high": float(v[-1]), "count": int(v.size)}
        for name, v in (
            ("frequency_hz", surface.frequency_hz),
            ("voltage_v", surface.voltage_v),
            ("normal_force_n", surface.normal_force_n),
        )
    }
    return {
        "content_hash": surface.content_hash,
        "axes": axes,
        "cof": {"low": float(np.nanmin(surface.cof)), "high": float(np.nanmax(surface.cof))},
        "cof_interval": _interval(surface),
        "share_pulled_in": float(surface.pulled_in.mean()),
        "share_outside_theory": float((~surface.within_theory).mean()),
        "share_outside_limits": float((~surface.within_limits).mean()),
        **{key: value for key, value in surface.provenance.items() if key != "model"},
        "model": surface.provenance["model"]["name"],
        "friction_law": surface.provenance["model"]["friction_law"],
        "dielectric": surface.provenance["model"]["dielectric"]["name"],
    }


def _interval(surface: SurfaceFile) -> dict[str, float] | None:
    """Half the 68 % interval of friction, relative, over all points where it ends; None where there
    is none.
    """
    if surface.cof_interval is None:
        return None
    low, high = surface.cof_interval
    ends = np.isfinite(low) & np.isfinite(high)
    half = 0.5 * np.log(high[ends] / low[ends])
    return {"median_relative": float(np.median(half)), "widest_relative": float(half.max())}


def _tell(content: dict[str, Any], indent: str) -> None:
    """What `describe` says, for a person: a line for each entry, tables of tables further in."""
    for key, value in content.items():
        if isinstance(value, dict) and any(isinstance(inner, dict) for inner in value.values()):
            stdout.print(f"{indent}{key}:")
            _tell(value, indent + "  ")
        else:
            stdout.print(f"{indent}{key}: {_words(value)}")


def _words(value: Any) -> str:
    """Short; all digits are in the JSON."""
    if isinstance(value, dict):
        return ", ".join(f"{key} {_words(inner)}" for key, inner in value.items())
    if isinstance(value, list):
        if isinstance(value[0], list):  # a curve
            return ", ".join(f"{_words(y)} at {_words(x)}" for x, y in value)
        return " to ".join(map(_words, value))
    return "none" if value is None else f"{value:.4g}" if isinstance(value, float) else str(value)


def _summary(surface: SurfaceFile) -> str:
    shape = " x ".join(map(str, surface.cof.shape))
    model = surface.provenance["model"]["name"]
    low, high = np.nanmin(surface.cof), np.nanmax(surface.cof)
    return (
        f"{shape} points of model '{model}', friction {low:.3f} to {high:.3f}, hash"
        f" {surface.content_hash[:16]}"
    )
