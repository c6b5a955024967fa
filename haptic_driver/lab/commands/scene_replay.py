"""`haptic scene replay`: the objects of a recording."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import numpy as np
from typer import Argument, Option

from haptic_driver.cli.output import Json, report, stdout
from haptic_driver.errors import BadInputError
from haptic_driver.files import require_free, write_text
from haptic_driver.lab.scene_replay import SceneReplay, scene_toml
from haptic_driver.pictures.textures import preview
from haptic_driver.recording.read import read_run


def scene_replay(
    recording: Annotated[Path, Argument(help="Recording, HDF5, made while a scene was rendered.")],
    out: Annotated[
        Path, Option(help="Scene as it was: .toml, a picture .png, or friction per tick .csv.")
    ],
    at: Annotated[
        float | None, Option(help="Seconds from the run's first tick; the end by default.")
    ] = None,
    run: Annotated[str | None, Option(help="Run, e.g. run_0001; the last one by default.")] = None,
    force: Annotated[bool, Option("--force", help="Overwrite what is there.")] = False,
    as_json: Json = False,
) -> None:
    """Make the scene of a recording again as it was at a moment, or what it asked for at each tick.

    Example: `haptic scene replay run.h5 --at 2.5 --out then.toml`
    """
    require_free(out, force)
    replayed = SceneReplay(read_run(recording, run))
    times_s = replayed.run.samples["time_s"]
    moment_s = float(times_s[-1]) if at is None else float(times_s[0]) + at
    payload: dict[str, Any] = {
        "recording": str(recording),
        "run": replayed.run.name,
        "changes": len(replayed.moments),
        "out": str(out),
        "differing": replayed.differing,
    }
    if out.suffix.lower() == ".csv":
        _write_ticks(replayed, out)
    else:
        _write_moment(replayed, moment_s, out)

    def lines() -> None:
        stdout.print(f"{out}: scene of {payload['run']}, {payload['changes']} changes")
        for name in replayed.differing:
            stdout.print(f"  {name} is not what it was when this was recorded")

    report(as_json, payload, lines)


def _write_ticks(replayed: SceneReplay, out: Path) -> None:
    samples = replayed.run.samples
    columns = [samples["time_s"], samples["asked_cof"], replayed.asked_cof()]
    names = "time_s,asked_cof,scene_cof"
    np.savetxt(out, np.column_stack(columns), "%.9g", ",", header=names, comments="")


def _write_moment(replayed: SceneReplay, moment_s: float, out: Path) -> None:
    described, scene = replayed.described_at(moment_s), replayed.scene_at(moment_s)
    if described is None or scene is None:
        said = "there was no scene at that moment"
        raise BadInputError("no_scene", said, "Give another --at")
    if out.suffix.lower() == ".toml":
        write_text(out, scene_toml(described))
    else:
        preview(scene, out, f"{replayed.run.name}, as it was")
